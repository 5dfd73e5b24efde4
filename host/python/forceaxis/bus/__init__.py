"""Access to axes on buses: LCM messages, commands through a gateway, the monitor, and logs."""
