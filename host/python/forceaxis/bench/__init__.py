"""Benchmarks: the simulator beside peers, the lock-step beside a bare ping-pong."""
