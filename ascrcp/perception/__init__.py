"""Recognise the heading: lidar lines or a cloud file -> tunnel surface with its findings (thesis chapter 3)."""
