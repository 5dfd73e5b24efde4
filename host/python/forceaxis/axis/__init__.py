"""Access to one axis over any connection: gateway, CAN, Modbus or simulation."""
