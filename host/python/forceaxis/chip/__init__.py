"""Images for chips: emulation, flashing."""
