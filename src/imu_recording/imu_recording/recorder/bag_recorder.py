# SPDX-License-Identifier: Apache-2.0
"""Record serialised messages so that a kill or a full disk costs at most the last second."""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from imu_recording.bags.decoding.message_types import definition_of
from imu_recording.bags.mcap.repair import repair_mcap
from imu_recording.bags.mcap.writer import McapStream
from imu_recording.bags.metadata import (
    Qos,
    RecordedFile,
    inspect_file,
    known_metadata,
    qos_text,
    write_metadata,
)
from imu_recording.logging_contract import PHASE_TOPIC, STRING
from imu_recording.recording import BagError

FULL_CHUNK_BYTES = 4 << 20
"""A chunk is closed early when its records reach this size."""


@dataclass
class _OpenFile:
    """The file being written."""

    path: Path
    descriptor: int
    stream: McapStream
    channels: dict[str, int] = field(default_factory=dict)
    written: int = 0


class BagRecorder:
    """One bag folder: `record` messages, `flush` once a second, `close` at the end.

    A new file begins when the phase on chamber/phase changes (`split_at_phase`) or a file exceeds
    `split_bytes` (0: never). What was flushed is on disk. A folder that holds files of an
    interrupted recording is continued with the next number; files that were cut are repaired. With
    `sync=False` nothing waits for the disk.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        metadata: Mapping[str, str] | None = None,
        split_at_phase: bool = True,
        split_bytes: int = 0,
        compression: str = 'zstd',
        sync: bool = True,
    ) -> None:
        self.folder = Path(folder)
        self.metadata = dict(metadata or {})
        self.messages = 0
        """Messages taken so far."""
        self._split_at_phase = split_at_phase
        self._split_bytes = split_bytes
        self._compression = compression
        self._sync = sync
        self._phase = ''
        self._types: dict[str, tuple[str, list[Qos]]] = {}
        self._open: _OpenFile | None = None
        self.repaired: dict[Path, int] = {}
        """Files that a kill had cut, and how many messages each of them has."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            old = sorted(self.folder.glob(f'{self.folder.name}_*.mcap'), key=_number)
        except OSError as error:
            raise BagError(f'{self.folder}: cannot be written ({error.strerror})') from None
        self._files: list[RecordedFile] = []
        for path in old:
            if (messages := repair_mcap(path, sync=sync)) is not None:
                self.repaired[path] = messages
            file, types = inspect_file(path)
            self._files.append(file)
            self._types |= types
        self.metadata = {**(known_metadata(self.folder) if old else {}), **self.metadata}
        self._next = 1 + max(map(_number, old), default=-1)
        if self.repaired:
            self._write_metadata()

    def record(
        self,
        topic: str,
        message_type: str,
        data: bytes | memoryview,
        received: int,
        *,
        qos: Sequence[Qos] = (),
    ) -> None:
        """Take one serialised message; `received` is its time of receipt [ns]."""
        if message_type == STRING and topic.endswith(f'/{PHASE_TOPIC}'):
            self.follow_phase(data)
        if self._open is not None and self._split_bytes and self._size() >= self._split_bytes:
            self.split()
        if self._open is None:
            self._begin()
        assert self._open is not None  # noqa: S101 (_begin opens it or raises)
        channel = self._open.channels.get(topic)
        if channel is None:
            self._types[topic] = (message_type, list(qos))
            channel = self._open.stream.add_channel(
                topic, message_type, definition_of(message_type), qos_text(qos)
            )
            self._open.channels[topic] = channel
        self._open.stream.add_message(channel, received, data)
        self.messages += 1
        if self._open.stream.pending >= FULL_CHUNK_BYTES:
            self._write(self._open.stream.flush())

    def flush(self) -> None:
        """Put everything taken so far on disk."""
        if self._open is None:
            return
        self._write(self._open.stream.flush())
        self._to_disk(self._open)

    def note(self, key: str, value: str) -> None:
        """Add to the metadata of the bag, in the file under way as well."""
        if self.metadata.get(key) == value:
            return
        self.metadata[key] = value
        if self._open is not None:
            stream = self._open.stream
            self._write(stream.flush() + stream.metadata('custom_data', self.metadata))
            self._write_metadata()

    def follow_phase(self, data: bytes | memoryview) -> None:
        """Begin a new file where this message of chamber/phase tells another phase."""
        phase = bytes(data[8:]).split(b'\0')[0].split(b' ')[0].decode(errors='replace')
        if self._split_at_phase and self._phase and phase != self._phase:
            self.split()
        self._phase = phase

    def split(self) -> None:
        """Finish the file; the next message begins another."""
        if self._open is None:
            return
        self._write(self._open.stream.end())
        open_file = self._open
        self._to_disk(open_file)
        self._open = None
        os.close(open_file.descriptor)
        self._files[-1] = _recorded(open_file)

    def close(self) -> None:
        """Finish the file and its metadata."""
        self.split()
        if self._files:
            self._write_metadata()

    def _size(self) -> int:
        assert self._open is not None  # noqa: S101 (callers checked)
        return self._open.written + self._open.stream.pending

    def _begin(self) -> None:
        path = self.folder / f'{self.folder.name}_{self._next}.mcap'
        stream = McapStream(compression=self._compression)
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            fcntl.flock(descriptor, fcntl.LOCK_EX)  # so that nobody repairs what is being written
        except OSError as error:
            raise BagError(f'{path}: cannot be written ({error.strerror})') from None
        self._open = _OpenFile(path, descriptor, stream)
        self._next += 1
        self._files.append(RecordedFile(path.name))
        self._write(stream.begin() + stream.metadata('custom_data', self.metadata))
        self._write_metadata()

    def _to_disk(self, open_file: _OpenFile) -> None:
        try:
            if self._sync:
                os.fsync(open_file.descriptor)
        except OSError as error:
            os.close(open_file.descriptor)
            self._open = None
            raise BagError(f'{open_file.path}: not on disk ({error.strerror})') from None

    def _write(self, data: bytes) -> None:
        """Append to the file; where that fails cut it back to what is whole and stop."""
        open_file = self._open
        assert open_file is not None  # noqa: S101 (callers checked)
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(open_file.descriptor, view) :]
        except OSError as error:
            os.ftruncate(open_file.descriptor, open_file.written)
            os.close(open_file.descriptor)
            self._open = None
            raise BagError(f'{open_file.path}: cannot be written ({error.strerror})') from None
        open_file.written += len(data)

    def _write_metadata(self) -> None:
        files = list(self._files)
        if self._open is not None:
            files[-1] = _recorded(self._open)
        try:
            write_metadata(self.folder, files, self._types, self.metadata, sync=self._sync)
        except OSError as error:
            file = self.folder / 'metadata.yaml'
            raise BagError(f'{file}: cannot be written ({error.strerror})') from None


def _recorded(open_file: _OpenFile) -> RecordedFile:
    first, last = open_file.stream.span
    counts = dict(zip(open_file.channels, open_file.stream.counts, strict=True))
    return RecordedFile(open_file.path.name, first=first, last=last, counts=counts)


def _number(path: Path) -> int:
    found = re.search(r'_(\d+)\.mcap$', path.name)
    return int(found[1]) if found else -1
