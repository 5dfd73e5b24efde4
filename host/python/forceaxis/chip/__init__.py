"""Functions that read image files of the firmware, write them to chips, and run them on an
emulator."""
