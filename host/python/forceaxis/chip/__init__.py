"""Reads images of the firmware, writes images to chips, and runs images on an emulator."""
