"""A WebSocket server for the viewer Foxglove. Clients can only read the topics of a live LCM bus or
of a recording.

The server announces no capabilities of the Foxglove protocol, so a client can only subscribe to
topics.
"""

import signal
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import foxglove

from forceaxis import signals
from forceaxis.bus.connections import bounded
from forceaxis.bus.sources import AddressError, MonitorSettings, ReplaySource
from forceaxis.bus.topics import Topic, Topics

LAYOUT = Path(__file__).with_name("foxglove_layout.json")
# Largest number of messages that wait for a slow client, about 40 s of one axis.
# If more messages wait for a client, the oldest messages are deleted.
# A client can recognise deleted messages by the ticks of the samples and the sequence numbers.
BACKLOG_MESSAGES = 1 << 16


class FoxgloveTopics:
    """Passes LCM messages to the Foxglove clients of a server. Each topic is created when its first
    message arrives."""

    def __init__(self, context: foxglove.Context, mm_per_count: float | None = None) -> None:
        self._context, self._topics = context, Topics(mm_per_count)
        self._channels: dict[Topic, foxglove.Channel] = {}

    def take(self, channel: str, data: bytes, wall_us: int) -> None:
        """Processes one LCM message, received at `wall_us` in us since 1970."""
        for message in self._topics.of(channel, data, wall_us):
            topic = message.topic
            if topic not in self._channels:
                schema = foxglove.Schema(
                    name=topic.schema_name, encoding=topic.schema_encoding, data=topic.schema
                )
                self._channels[topic] = foxglove.Channel(
                    topic.name,
                    schema=schema,
                    message_encoding=topic.encoding,
                    context=self._context,
                )
            self._channels[topic].log(message.data, log_time=message.time_ns)


def serve(
    settings: MonitorSettings,
    host: str,
    port: int,
    record: Path | None,
    ready: Callable[[str], None],
) -> int:
    """Serves the topics until SIGINT or SIGTERM, and returns the number of the signal. `record` is
    the path of a new file to which the messages are recorded, or None. Calls ready(url) when the
    server listens. Raises AddressError, InputError."""
    ended, number = threading.Event(), signal.SIGTERM

    def end(received: int, _: FrameType | None) -> None:
        nonlocal number
        number = signal.Signals(received)
        ended.set()

    # Without this call, the library prints a line for each failed handshake.
    foxglove.set_log_level("CRITICAL")
    context = foxglove.Context()
    source = settings.source(FoxgloveTopics(context, settings.mm_per_count))
    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, end)
    try:
        if record:
            source.record(record)
        try:
            server = foxglove.start_server(
                name="forceaxis",
                host=host,
                port=port,
                context=context,
                capabilities=[],
                message_backlog_size=BACKLOG_MESSAGES,
            )
        except RuntimeError as error:
            raise AddressError(str(error).removeprefix("FoxgloveError: ")) from None
        try:
            with bounded(server.port):
                ready(f"ws://{f'[{host}]' if ':' in host else host}:{server.port}")
                if isinstance(source, ReplaySource):
                    source.start()
                signals.wait(ended)
        finally:
            server.stop()
    finally:
        source.close()
    return number
