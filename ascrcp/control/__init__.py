"""Drives from targets and measurements: joint control, moves, the tracker of thesis fig. 5-2."""
