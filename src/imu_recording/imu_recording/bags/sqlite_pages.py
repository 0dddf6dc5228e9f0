# SPDX-License-Identifier: Apache-2.0
"""Read the messages table of a closed sqlite3 file page by page, in order of its rows.

File format: https://www.sqlite.org/fileformat2.html, sections 1.3 (header), 1.6 (b-tree pages),
2.1 (records). Whatever is not plain ends the walk; the rows behind it are left to sqlite itself.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.bags.decoding.cdr import Bytes
from imu_recording.bags.decoding.topic_columns import MessageBlock, empty_block
from imu_recording.jit import njit
from imu_recording.recording import IntArray

INTERIOR_PAGE, LEAF_PAGE = 0x05, 0x0D
PAGES_PER_READ = 512
"""Leaf pages decoded at a time."""
LARGEST_GROUP_SPREAD = 3
"""Largest spread of a group's pages, in groups, that is read at once; wider ones page by page."""
JOURNAL_SUFFIXES = ('-wal', '-journal')
LARGEST_COLUMN_COUNT = 16
PADDING_BYTES = 64
"""Bytes behind the last page, so that a number cut by its end is read within the buffer."""
LARGEST_COLUMN_BYTES = 1 << 31
"""A column that claims to be longer is damage [bytes]."""
_INTEGER_BYTES = np.array([0, 1, 2, 3, 4, 6, 8, 8, 0, 0], np.int64)


class NotPlainError(Exception):
    """A structure this reader leaves to sqlite."""


@dataclass(frozen=True)
class MessagesTable:
    """Where the messages of a file are."""

    root: int
    """Page at which the table's tree starts."""
    topic: int
    """Places of the columns topic_id, timestamp and data."""
    timestamp: int
    data: int


def scan_pages(
    path: Path, table: MessagesTable, slots: IntArray, deliver: Callable[[MessageBlock], None]
) -> int:
    """Deliver the messages of wanted topics (`slots`: number → slot or −1) as far as is plain.

    Returns the number of the last row that was looked at; what follows is for sqlite.
    """
    if any(_size(Path(f'{path}{ending}')) for ending in JOURNAL_SUFFIXES):
        return -1
    last = -1
    descriptor = os.open(path, os.O_RDONLY)
    try:
        page_size, usable = _page_size(os.pread(descriptor, 100, 0), _size(path))
        places = (table.topic, table.timestamp, table.data)
        for pages in _groups(_leaves(descriptor, table.root, page_size)):
            buffer, starts = _read(descriptor, pages, page_size)
            arrays = empty_block(len(pages) * (usable // 32))
            count, last, plain = read_leaves(
                buffer, starts, usable, places, slots, _INTEGER_BYTES, arrays, last
            )
            if count:
                offset, length, received, slot = arrays
                block = MessageBlock(
                    buffer=buffer,
                    offset=offset,
                    length=length,
                    received=received,
                    slot=slot,
                    count=count,
                )
                deliver(block)
            if not plain:
                break
    except (NotPlainError, OSError):
        pass  # sqlite reads the rest, or says what is wrong
    finally:
        os.close(descriptor)
    return int(last)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _page_size(header: bytes, file_size: int) -> tuple[int, int]:
    """Return the page size and how much of a page is used."""
    size = int.from_bytes(header[16:18], 'big')
    size = 65536 if size == 1 else size
    pages = int.from_bytes(header[28:32], 'big')
    if size < 512 or size & (size - 1) or pages * size != file_size:
        raise NotPlainError
    return size, size - header[20]


def _leaves(descriptor: int, root: int, page_size: int) -> Iterator[int]:
    """Give the leaf pages below a page, in order of their rows."""
    page = os.pread(descriptor, page_size, (root - 1) * page_size)
    at = 100 if root == 1 else 0
    if len(page) < page_size or page[at] not in (INTERIOR_PAGE, LEAF_PAGE):
        raise NotPlainError
    if page[at] == LEAF_PAGE:
        yield root
        return
    yield from _below(descriptor, page, at, page_size, depth=0)


def _below(descriptor: int, page: bytes, at: int, page_size: int, *, depth: int) -> Iterator[int]:
    """Give the leaf pages below an interior page; all leaves of a tree are equally deep."""
    count = int.from_bytes(page[at + 3 : at + 5], 'big')
    pointers = np.frombuffer(page, '>u2', count, at + 12).astype(int)
    if depth > 12 or (count and pointers.max() > page_size - 4):
        raise NotPlainError
    children = [int.from_bytes(page[p : p + 4], 'big') for p in pointers.tolist()]
    children.append(int.from_bytes(page[at + 8 : at + 12], 'big'))
    first = os.pread(descriptor, page_size, (children[0] - 1) * page_size)
    if len(first) < page_size:
        raise NotPlainError
    if first[0] == LEAF_PAGE:
        yield from children
        return
    for child in children:
        content = os.pread(descriptor, page_size, (child - 1) * page_size)
        if len(content) < page_size or content[0] != INTERIOR_PAGE:
            raise NotPlainError
        yield from _below(descriptor, content, 0, page_size, depth=depth + 1)


def _groups(pages: Iterator[int]) -> Iterator[list[int]]:
    """Give the pages in groups; those found before the walk ends come first."""
    group: list[int] = []
    failed = False
    while not failed:
        try:
            page = next(pages, None)
        except NotPlainError:
            failed, page = True, None
        if page is not None:
            group.append(page)
        if group and (page is None or len(group) == PAGES_PER_READ):
            yield group
            group = []
        if page is None:
            break
    if failed:
        raise NotPlainError


def _read(
    descriptor: int, pages: list[int], page_size: int
) -> tuple[np.ndarray[tuple[int], np.dtype[np.uint8]], IntArray]:
    """Return the pages' bytes in one buffer and where each starts."""
    numbers = np.array(pages, np.int64) - 1
    first, last = int(numbers.min()), int(numbers.max())
    if last - first < LARGEST_GROUP_SPREAD * max(len(pages), 64):
        reads = [(first, last - first + 1)]
        starts = (numbers - first) * page_size
    else:
        reads = [(number, 1) for number in numbers.tolist()]
        starts = np.arange(len(pages), dtype=np.int64) * page_size
    length = sum(count for _, count in reads) * page_size
    buffer = np.zeros(length + PADDING_BYTES, np.uint8)
    at = 0
    for number, count in reads:
        view = memoryview(buffer)[at : at + count * page_size]
        at += os.preadv(descriptor, [view], number * page_size)
    if at < length:
        raise NotPlainError
    return buffer, starts


@njit(cache=True, nogil=True)
def varint(buffer: Bytes, at: int) -> tuple[Any, Any]:
    """Return a variable-length integer and the byte behind it."""
    value = np.int64(0)
    for k in range(8):
        byte = np.int64(buffer[at + k])
        value = (value << 7) | (byte & 127)
        if byte < 128:
            return value, at + k + 1
    return (value << 8) | np.int64(buffer[at + 8]), at + 9


@njit(cache=True, nogil=True)
def big_endian(buffer: Bytes, at: int, width: int) -> Any:
    """Return a signed big-endian integer of 1 to 8 bytes."""
    value = np.int64(buffer[at])
    if value >= 128:
        value -= 256
    for k in range(1, width):
        value = (value << 8) | np.int64(buffer[at + k])
    return value


@njit(cache=True, nogil=True)
def read_record(
    buffer: Bytes, at: int, end: int, places: tuple[int, int, int], widths: IntArray
) -> tuple[Any, Any, Any, Any]:
    """Return (topic, timestamp, byte and length of data); length −1 where it is not plain."""
    topic, moment, data, length = np.int64(-1), np.int64(0), np.int64(0), np.int64(-1)
    size, head = varint(buffer, at)
    if size < 1 or size > end - at:
        return topic, moment, data, length
    body = at + size
    stop = body
    column = 0
    while head < stop:
        kind, head = varint(buffer, head)
        if kind < 0 or kind > LARGEST_COLUMN_BYTES or body > end:
            return topic, moment, data, np.int64(-1)
        blob = kind >= 12
        width = (kind - 12) // 2 if blob else widths[min(kind, 9)]
        number = kind - 8 if kind >= 8 else np.int64(0)
        if column == places[2]:
            data, length = body, width if blob else np.int64(-1)
        elif column == places[0] or column == places[1]:
            if blob or kind in (0, 7) or body + width > end:
                return topic, moment, data, np.int64(-1)
            if width:
                number = big_endian(buffer, body, width)
            if column == places[0]:
                topic = number
            else:
                moment = number
        body += width
        column += 1
    return topic, moment, data, length


@njit(cache=True, nogil=True)
def read_leaves(
    buffer: Bytes,
    starts: IntArray,
    usable: int,
    places: tuple[int, int, int],
    slots: IntArray,
    widths: IntArray,
    arrays: tuple[IntArray, ...],
    last: int,
) -> tuple[int, int, bool]:
    """List the wanted messages of leaf pages; return their number, the last row, whether plain."""
    offset, length, received, slot = arrays
    found = 0
    for start in starts:
        if buffer[start] != 13:
            return found, last, False
        cells = (np.int64(buffer[start + 3]) << 8) | np.int64(buffer[start + 4])
        end = start + usable
        if 8 + 2 * cells > usable:
            return found, last, False
        for cell in range(cells):
            pointer = start + 8 + 2 * cell
            at = start + ((np.int64(buffer[pointer]) << 8) | np.int64(buffer[pointer + 1]))
            if at + 4 > end:
                return found, last, False
            payload, at = varint(buffer, at)
            row, at = varint(buffer, at)
            if row <= last:
                return found, last, False
            whole = payload <= usable - 35
            topic, moment, data, size = read_record(buffer, at, end, places, widths)
            wanted = slots[topic] if 0 <= topic < slots.shape[0] else -1
            if wanted >= 0:
                fits = whole and size >= 0 and data + size <= end
                if not fits or found == offset.shape[0]:
                    return found, last, False
                offset[found] = data
                length[found] = size
                received[found] = moment
                slot[found] = wanted
                found += 1
            last = row
    return found, last, True
