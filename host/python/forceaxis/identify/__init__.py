"""Measured frequency responses, and identification of parameters from measured responses."""
