"""Measured frequency responses, and parameters identified from them."""
