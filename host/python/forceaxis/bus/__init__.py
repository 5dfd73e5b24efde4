"""Axes on buses: the gateway, LCM, the monitor, logs."""
