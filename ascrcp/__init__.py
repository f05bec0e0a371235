"""Automatic Shotcrete Robot Control Platform."""
