"""Sources of messages for the monitor. A source is a live bus, whose messages can be recorded, or
the replay of a log."""

import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.bus.lcm import Bus, default_url, now_us
from forceaxis.bus.recordings import RecordingWriter, no_messages, reader_of, writer_of


class AddressError(InputError):
    """Error: a server cannot listen at the given address and port."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"expected an address of this machine and a free port, got: {reason}; choose another "
            "address or port"
        )


class Receiver(Protocol):
    """Receives each message of a source: channel, data, and time of reception in us since 1970."""

    def take(self, channel: str, data: bytes, wall_us: int) -> None: ...


class LiveSource:
    """Source of messages from a live bus. The thread of the connection calls watch.take() for each
    message."""

    replayed = ended = False

    def __init__(self, watch: Receiver, url: str | None = None, axis: int | None = None) -> None:
        self.watch, self.url = watch, url or default_url()
        self.writer: RecordingWriter | None = None
        self.unwritten: str | None = None  # text of the error that has ended a recording, or None
        self._lock = threading.Lock()
        which = "[0-9]+" if axis is None else str(axis)
        # LINK_INPUTS and LINK_OUTPUTS contain the data of each tick of a run in lock-step.
        kinds = "STATE|EVENT|CAPTURE|COMMAND|LINK_INPUTS|LINK_OUTPUTS"
        channels = f"(AXIS_{which}_({kinds})|SIM_(CLOCK|TRUTH))"
        self._bus = Bus(self.url, self._take, channels)

    @property
    def name(self) -> str:
        return self.url

    @property
    def trouble(self) -> str | None:
        return self._bus.trouble or self.unwritten

    def now_us(self) -> float:
        return now_us()

    def _take(self, channel: str, data: bytes, wall_us: int) -> None:
        with self._lock:
            if self.writer:
                try:
                    self.writer.write(channel, data, wall_us)
                # An error such as a full disk ends only the recording. The monitor continues.
                except OSError as error:
                    path, self.writer = self.writer.path, None
                    self.unwritten = f"recording ended: {paths.display(path)}: {error.strerror}"
        self.watch.take(channel, data, wall_us)

    def record(self, path: Path) -> None:
        """Starts to record the messages in a new file. Raises InputError if the file exists."""
        writer = writer_of(path)
        with self._lock:
            self.writer, self.unwritten = writer, None

    def stop_recording(self) -> RecordingWriter | None:
        """Ends the recording and returns its writer. Returns None if no recording is active."""
        with self._lock:
            writer, self.writer = self.writer, None
        if writer:
            try:
                writer.close()
            except OSError as error:
                self.unwritten = f"recording: {paths.display(writer.path)}: {error.strerror}"
        return writer

    def close(self) -> None:
        self._bus.close()
        self.stop_recording()


class ReplaySource:
    """Source of messages from a log. The messages are passed to `watch` at `speed` times their
    original rate. If `speed` is None, there is no waiting time between messages."""

    replayed = True
    writer: RecordingWriter | None = None

    def __init__(
        self, watch: Receiver, path: Path, speed: float | None = 1.0, axis: int | None = None
    ) -> None:
        self.watch, self.path, self.speed = watch, path, speed
        self.reader = reader_of(path)
        first = next(iter(self.reader), None)
        if first is None:
            raise no_messages(self.reader)
        self._own = None if axis is None else f"AXIS_{axis}_"
        self._at_us: float = first.wall_us
        self._start_us, self.ended, self._run = first.wall_us, False, True
        self.trouble: str | None = None
        self._go = threading.Event()
        self._go.set()
        self._thread: threading.Thread | None = None

    @property
    def name(self) -> str:
        speed = "" if self.speed is None or self.speed == 1 else f" x {self.speed:g}"
        return f"replay of {self.path.name}{speed}"

    def start(self) -> None:
        self._thread = threading.Thread(target=self._play, daemon=True, name="replay")
        self._thread.start()

    def play_all(self) -> None:
        """Passes all messages of the log without waiting, in the thread of the caller."""
        self.speed = None
        self._play()

    def now_us(self) -> float:
        return self._at_us

    def position_s(self) -> float:
        return (self._at_us - self._start_us) / 1e6

    def record(self, path: Path) -> None:
        """Raises InputError. The messages of a replay cannot be recorded, because they are already
        in a log."""
        raise InputError(
            "expected a live bus whose messages can be recorded, got the replay of a log; copy "
            "this log instead"
        )

    def stop_recording(self) -> RecordingWriter | None:
        """Returns None, because a replay cannot be recorded."""
        return None

    def pause(self, paused: bool) -> None:
        self._go.clear() if paused else self._go.set()

    def close(self) -> None:
        self._run = False
        self._go.set()
        if self._thread:
            self._thread.join(2)

    def _play(self) -> None:
        clock = time.monotonic()
        for entry in self.reader:
            while self.speed:
                if not self._go.is_set():
                    self._go.wait()
                    clock = time.monotonic()
                now = time.monotonic()
                self._at_us += (now - clock) * 1e6 * self.speed
                clock, ahead = now, (entry.wall_us - self._at_us) / 1e6 / self.speed
                if ahead <= 0 or not self._run:
                    break
                # The sleeps are short, so that a pause or the end of the program takes effect soon.
                time.sleep(min(ahead, 0.05))
            if not self._run:
                return
            self._at_us = max(self._at_us, entry.wall_us)
            if self._own is None or entry.channel.startswith((self._own, "SIM_")):
                self.watch.take(entry.channel, entry.data, entry.wall_us)
        self.ended, self.trouble = True, self.reader.damage


Source = LiveSource | ReplaySource


@dataclass(frozen=True)
class MonitorSettings:
    """Settings of a monitor. `axis`: number of the axis that is shown, or None for all axes. `url`:
    URL of the LCM bus. `replay`: log file that is shown instead of a live bus, at `speed` times its
    original speed."""

    url: str | None
    axis: int | None
    speed: float
    replay: Path | None
    mm_per_count: float | None

    def source(self, watch: Receiver) -> Source:
        """Returns a source that passes each of its messages to `watch`. Raises InputError."""
        if self.replay:
            return ReplaySource(watch, self.replay, self.speed, self.axis)
        return LiveSource(watch, self.url, self.axis)
