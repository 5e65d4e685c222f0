"""Firmware: the exact allocator of one vehicle, as C99 for a flight controller."""
