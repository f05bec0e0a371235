"""Automatic Shotcrete Robot Control Platform."""

__version__ = "0.1.0"
