"""Recognise the heading: lidar lines or a cloud file -> Surface with its findings (thesis chapter 3)."""
