"""Devices at the other end of a wire: CAN bus and codec, lidar, pan head, joystick."""
