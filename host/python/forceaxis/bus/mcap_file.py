"""Recordings of LCM messages as MCAP files. Each LCM channel becomes two topics; see
forceaxis.bus.topics.

Viewers read the topics in JSON. This program reads the topics with the bytes of the LCM messages,
so that an MCAP file and a log contain the same messages.
"""

import dataclasses
import io
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.records import Channel, Chunk, McapRecord, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from forceaxis import paths
from forceaxis.bus.log import LogEntry, new_file
from forceaxis.bus.topics import LCM, NS_PER_US, RAW, Topic, Topics

PROFILE = "forceaxis"
# Size of a chunk of an MCAP file in bytes.
# If the program is killed, only the messages of one chunk are lost.
CHUNK_BYTES = 1 << 18
# largest size of a record in bytes; a record that states a larger size is damaged
RECORD_MOST_BYTES = 1 << 28


class McapWriter:
    """Writes LCM messages to a new MCAP file. It has the same methods as a LogWriter. Raises
    InputError if the file exists."""

    def __init__(self, path: Path, stream: BinaryIO | None = None) -> None:
        self.path, self.count = path, 0
        self._topics = Topics()
        self._channels: dict[Topic, int] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._file = new_file(path) if stream is None else stream
        self._flushed = time.monotonic()
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile=PROFILE, library="forceaxis")

    def write(self, channel: str, data: bytes, wall_us: int) -> None:
        """Adds one LCM message, received at `wall_us` in us since 1970. Raises OSError."""
        for message in self._topics.of(channel, data, wall_us):
            self._writer.add_message(
                self._channel(message.topic), message.time_ns, message.data, message.time_ns
            )
        self.count += 1
        if (now := time.monotonic()) > self._flushed + 0.5:
            self._file.flush()
            self._flushed = now

    def _channel(self, topic: Topic) -> int:
        """Returns the number of the MCAP channel of a topic. The channel is registered when its
        first message is written."""
        if topic not in self._channels:
            schema = 0
            if topic.schema_name:
                key = topic.schema_name, topic.schema
                if key not in self._schemas:
                    self._schemas[key] = self._writer.register_schema(
                        topic.schema_name, topic.schema_encoding, topic.schema
                    )
                schema = self._schemas[key]
            self._channels[topic] = self._writer.register_channel(
                topic.name, topic.encoding, schema
            )
        return self._channels[topic]

    def close(self) -> None:
        """Writes the index and closes the file. Raises OSError."""
        try:
            self._writer.finish()
        finally:
            self._file.close()


def _unpacked(chunk: Chunk) -> Chunk:
    """Decompresses a chunk. Raises ValueError if the decompressed data are larger than
    RECORD_MOST_BYTES, even if the chunk states a smaller size. Also raises the exceptions of the
    packages that decompress."""
    most = RECORD_MOST_BYTES + 1
    if chunk.compression == "zstd":
        import zstandard

        data = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(chunk.data)).read(most)
    elif chunk.compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        data = LZ4FrameDecompressor().decompress(chunk.data, max_length=most)
    else:
        data = chunk.data
    if len(data) >= most:
        raise ValueError(f"a chunk of more than {RECORD_MOST_BYTES >> 20} MiB")
    return dataclasses.replace(chunk, compression="", data=data)


class McapReader:
    """Iterates over the LCM messages of an MCAP file. It has the same methods as a LogReader. After
    the iteration, `damage` is one text line about a damaged or incomplete file, or None. Raises
    InputError."""

    def __init__(self, path: Path) -> None:
        self.path, self.count = path, 0
        self.others: dict[str, int] = {}  # {encoding: number of messages of other programs}
        self._schemas: dict[int, Schema] = {}
        self._reason: str | None = None

    def schema_of(self, channel: Channel) -> Schema | None:
        """Returns the schema of the messages of a channel that messages() has yielded, or None."""
        return self._schemas.get(channel.schema_id)

    def __iter__(self) -> Iterator[LogEntry]:
        for channel, message in self.messages():
            if channel.message_encoding == LCM:
                name = channel.topic.removeprefix(RAW)
                yield LogEntry(message.log_time // NS_PER_US, name, message.data)

    def messages(self) -> Iterator[tuple[Channel, McapMessage]]:
        """Yields all messages with their channels, in the order of the file."""
        self.count, self.others, self._reason = 0, {}, None
        channels: dict[int, Channel] = {}
        self._schemas.clear()
        with self.path.open("rb") as stream:
            for record in self._records(stream):
                if isinstance(record, Schema):
                    self._schemas[record.id] = record
                if isinstance(record, Channel):
                    channels[record.id] = record
                if isinstance(record, McapMessage) and record.channel_id in channels:
                    channel = channels[record.channel_id]
                    encoding = channel.message_encoding
                    self.count += encoding == LCM
                    if encoding != LCM:
                        self.others[encoding] = self.others.get(encoding, 0) + 1
                    yield channel, record

    def _records(self, stream: BinaryIO) -> Iterator[McapRecord]:
        """Yields the records of a file. The records in a damaged chunk are left out. If the file is
        damaged outside of a chunk, all later records are left out. A chunk that a package cannot
        decompress is regarded as damaged."""
        reader = StreamReader(stream, emit_chunks=True, record_size_limit=RECORD_MOST_BYTES)
        records = reader.records
        while True:
            try:
                record = next(records)
                inner = [record]
                if isinstance(record, Chunk):
                    inner = breakup_chunk(_unpacked(record), validate_crc=True)
            except StopIteration:
                return
            except Exception as error:
                self._reason = " ".join(str(error).split()) or "the end is missing"
                inner = []
            yield from inner

    @property
    def damage(self) -> str | None:
        """Returns one text line about the damage of the file, or None."""
        if self._reason is None:
            return None
        return (
            f"{paths.display(self.path)}: is damaged or cut off ({self._reason}), "
            f"{self.count or sum(self.others.values())} messages saved"
        )
