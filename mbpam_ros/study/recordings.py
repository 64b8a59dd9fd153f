"""Recordings of ROS topics as MCAP files, written so that a killed recorder loses little, and read in their order.

A recording is ``FILE.mcap`` and, once that has its full size, ``FILE_1.mcap`` and so on. Messages stand in it as they
came over the wire, each channel with the definition of its type and the QoS it was offered with, as rosbag2 writes
them. What is written is handed to the operating system at every :meth:`RecordingWriter.flush`: from then on it outlives
the process. A file that nobody finished has no index; it is read to its last whole chunk.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from mbpam_ros.errors import MbpamError

if TYPE_CHECKING:
    from mcap.writer import Writer

SUFFIX = ".mcap"
LIBRARY = "mbpam_ros"


class RecordingError(MbpamError, RuntimeError):
    """A recording cannot be written or read; the message says where and why."""


@dataclass(frozen=True)
class Recorded:
    """One message of a recording.

    Args:
        topic: its full name.
        type_name: such as ``sensor_msgs/msg/JointState``.
        received_ns: when the recorder received it, by the clock of its computer.
        data: as serialised by ROS (CDR).
    """

    topic: str
    type_name: str
    received_ns: int
    data: bytes


class RecordingWriter:
    """Writes a recording; a file of full size is finished and the next begun.

    Args:
        path: of the first file; its suffix is ``.mcap``.
        definition_of: definition of a type by its name, with those of all types in it.
        split_bytes: size of a file after which the next one is begun.

    Raises:
        RecordingError: another suffix, a file that is there already, or it cannot be written.
        ModuleNotFoundError: mcap is not installed.
    """

    def __init__(self, path: Path, definition_of: Callable[[str], str], split_bytes: int) -> None:
        if path.suffix != SUFFIX:
            raise RecordingError(f"{path}: a recording's name ends with {SUFFIX}")
        self._definition_of, self._split_bytes, self._first = definition_of, split_bytes, path
        self.paths: list[Path] = []
        self.counts: Counter[str] = Counter()
        self._begin()

    def write(self, message: Recorded, qos: str) -> None:
        """Write one message of a topic that was offered with ``qos``, YAML as rosbag2 has it.

        Raises:
            RecordingError: the disk is full, or gone.
        """
        try:
            channel = self._channels.get(message.topic)
            if channel is None:
                channel = self._channels[message.topic] = self._new_channel(message, qos)
            self._writer.add_message(channel, message.received_ns, message.data, message.received_ns)
            self.counts[message.topic] += 1
            if self._file.tell() > self._split_bytes:
                self.close()
                self._begin()
        except OSError as error:
            raise RecordingError(f"{self.paths[-1]}: {error.strerror or error}") from error

    def flush(self) -> None:
        """Hand all that was written to the operating system."""
        try:
            self._writer.flush()
        except OSError as error:
            raise RecordingError(f"{self.paths[-1]}: {error.strerror or error}") from error

    def close(self) -> None:
        """Finish the file, with its index."""
        try:
            self._writer.finish()
            self._file.close()
        except OSError as error:
            raise RecordingError(f"{self.paths[-1]}: {error.strerror or error}") from error

    def _begin(self) -> None:
        from mcap.writer import CompressionType, Writer

        path = _part(self._first, len(self.paths))
        try:
            self._file: BinaryIO = path.open("xb")
        except FileExistsError as error:
            raise RecordingError(f"{path} is there already; give another file, or remove it") from error
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror or error}") from error
        self.paths.append(path)
        self._writer: Writer = Writer(self._file, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def _new_channel(self, message: Recorded, qos: str) -> int:
        name = message.type_name
        if name not in self._schemas:
            definition = self._definition_of(name).encode()
            self._schemas[name] = self._writer.register_schema(name, "ros2msg", definition)
        metadata = {"offered_qos_profiles": qos}
        return self._writer.register_channel(message.topic, "cdr", self._schemas[name], metadata)


def read_recording(path: Path) -> Iterator[Recorded]:
    """Yield the messages of a recording in the order they were written, from its first file to its last.

    Raises:
        RecordingError: there is no such file, or it is no MCAP file of ROS 2 messages.
        ModuleNotFoundError: mcap is not installed.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such recording")
    number = 0
    while (part := _part(path, number)).is_file():
        yield from _read_file(part)
        number += 1


def _part(first: Path, number: int) -> Path:
    return first if number == 0 else first.with_name(f"{first.stem}_{number}{SUFFIX}")


def _read_file(path: Path) -> Iterator[Recorded]:
    from mcap.exceptions import EndOfFile, McapError
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    types: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    with path.open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Schema):
                    types[record.id] = record.name
                elif isinstance(record, Channel):
                    if record.message_encoding != "cdr":
                        raise RecordingError(f"{path}: {record.topic} is encoded as {record.message_encoding}, not cdr")
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    yield Recorded(channel.topic, types[channel.schema_id], record.log_time, record.data)
        except (EndOfFile, struct.error):
            return  # nobody finished it
        except (McapError, KeyError, OSError) as error:
            raise RecordingError(f"{path}: no recording: {error}") from error
