"""The rig at the other end of the wires: hydraulics, tunnel, lidar, CAN nodes."""
