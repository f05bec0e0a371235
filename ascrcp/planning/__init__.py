"""From the recognised surface to the nozzle's path and from solved joints to joints against time."""
