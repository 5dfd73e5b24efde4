"""Access to axes on buses: LCM messages, commands through a gateway, the monitor, and logs."""

# Default node id of this program on CAN. A gateway has the node id 127.
OWN_NODE = 126
