"""An LCM network that loses datagrams, between the clients of one URL and a gateway at another.

A thread for each direction passes the messages on, except those for which `lost(channel, data)` is
True. Each message is one datagram, because none is longer than 64 KiB.
"""

import random
import threading

import lcm

DIRECTIONS = "AXIS_[0-9]+_COMMAND", "AXIS_[0-9]+_(STATE|EVENT|CAPTURE)"


class LossyLink:
    def __init__(self, clients_url, gateway_url, lost):
        self.lost, self.dropped, self.passed = lost, 0, 0
        self._lock, self._end = threading.Lock(), threading.Event()
        ends = lcm.LCM(clients_url), lcm.LCM(gateway_url)
        self._threads = [
            threading.Thread(target=self._relay, args=(*way, channels), daemon=True)
            for way, channels in zip((ends, ends[::-1]), DIRECTIONS, strict=True)
        ]
        self._listening = threading.Barrier(len(self._threads) + 1)
        for thread in self._threads:
            thread.start()
        self._listening.wait(10)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._end.set()
        for thread in self._threads:
            thread.join(5)

    def _relay(self, source, target, channels):
        def take(channel, data):
            with self._lock:
                is_lost = self.lost(channel, data)
                self.dropped += is_lost
                self.passed += not is_lost
            if not is_lost:
                target.publish(channel, data)

        subscription = source.subscribe(channels, take)
        subscription.set_queue_capacity(20_000)
        self._listening.wait(10)
        while not self._end.is_set():
            source.handle_timeout(50)
        source.unsubscribe(subscription)


def at_random(seed, share):
    """A `lost` that drops this share of all messages, the same ones for a seed and an order."""
    drawn = random.Random(seed)
    return lambda channel, data: drawn.random() < share
