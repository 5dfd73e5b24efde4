"""Waiting in the main thread of a program that handles signals.

The system may deliver a signal to any thread. Python handles it in the main thread, and a main
thread that waits without an end is not woken for it.
"""

import threading

# Longest time in s until a waiting main thread handles a signal.
NOTICED_S = 0.05


def wait(event: threading.Event) -> None:
    """Wait until the event is set. Signals are handled meanwhile."""
    while not event.wait(NOTICED_S):
        pass
