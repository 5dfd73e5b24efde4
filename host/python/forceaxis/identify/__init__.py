"""Measured responses, and what is identified from them."""
