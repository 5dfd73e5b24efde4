"""One axis, by whatever carries its objects: gateway, CAN, Modbus, or a simulated one."""
