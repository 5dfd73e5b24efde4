"""Axes on buses: LCM, sessions through the gateway, the monitor, logs."""
