"""Reads image files of the firmware, writes them to chips, and runs them on an emulator."""
