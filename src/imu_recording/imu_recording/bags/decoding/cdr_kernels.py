# SPDX-License-Identifier: Apache-2.0
"""Kernels that copy the numbers of serialised messages into columns."""

from __future__ import annotations

from typing import Any

import numpy as np

from imu_recording.bags.decoding.cdr import Bytes
from imu_recording.jit import njit
from imu_recording.recording import IntArray

MINUS_ONE_WORD = np.array([-1.0]).view(np.int64)[0]
NAN_WORD = np.array([np.nan]).view(np.int64)[0]


@njit(cache=True)
def little32(buffer: Bytes, at: int) -> Any:
    """Return the unsigned 32-bit integer at a byte as int64."""
    return (
        np.int64(buffer[at])
        | (np.int64(buffer[at + 1]) << 8)
        | (np.int64(buffer[at + 2]) << 16)
        | (np.int64(buffer[at + 3]) << 24)
    )


@njit(cache=True)
def little64(buffer: Bytes, at: int) -> Any:
    """Return the 64 bits at a byte as int64."""
    return (
        np.int64(buffer[at])
        | (np.int64(buffer[at + 1]) << 8)
        | (np.int64(buffer[at + 2]) << 16)
        | (np.int64(buffer[at + 3]) << 24)
        | (np.int64(buffer[at + 4]) << 32)
        | (np.int64(buffer[at + 5]) << 40)
        | (np.int64(buffer[at + 6]) << 48)
        | (np.int64(buffer[at + 7]) << 56)
    )


@njit(cache=True, nogil=True)
def is_expected(
    buffer: Bytes, at: int, length: int, size: int, frame: Bytes, stamped: int
) -> bool:
    """Tell whether a message has the expected encapsulation, length and frame_id."""
    if length != size or little32(buffer, at) != 256:
        return False
    if not stamped:
        return True
    text = frame.shape[0]
    if little32(buffer, at + 12) != text + 1 or buffer[at + 16 + text] != 0:
        return False
    for j in range(text):  # noqa: SIM110 (numba compiles loops, not generators)
        if buffer[at + 16 + j] != frame[j]:
            return False
    return True


@njit(cache=True, nogil=True)
def header_stamp(buffer: Bytes, at: int) -> Any:
    """Return the stamp of a message with a header [ns]."""
    seconds = little32(buffer, at + 4)
    if seconds >= 2147483648:
        seconds -= 4294967296
    return seconds * 1000000000 + little32(buffer, at + 8)


@njit(cache=True, nogil=True)
def copy_group(buffer: Bytes, at: int, first: int, mark: int, out: IntArray, row: int) -> int:
    """Copy the doubles of one group to a row; return 1 where it is marked as not reported."""
    if mark >= 0 and little64(buffer, at + 8 * mark) == MINUS_ONE_WORD:
        for j in range(out.shape[1]):
            out[row, j] = NAN_WORD
        return 1
    for j in range(out.shape[1]):
        out[row, j] = little64(buffer, at + 8 * (first + j))
    return 0


@njit(cache=True, nogil=True)
def decode_messages(
    buffer: Bytes,
    messages: tuple[IntArray, IntArray, IntArray, IntArray],
    span: tuple[int, int],
    wanted: int,
    frame: Bytes,
    shape: tuple[int, ...],
    out: tuple[IntArray, IntArray, IntArray, IntArray],
    row: int,
) -> tuple[int, int, int]:
    """Copy the numbers of one slot's messages into columns, until one has another layout.

    `messages` are a block's arrays offset, length, received and slot, `span` (from, to) those to
    look at; `frame` holds the bytes of the expected frame_id; `shape` (stamped, doubles, first
    group: index, mark, second group: index, mark). `out` (stamp (m,), receipt (m,), first group
    (m, k), second group (m, k)) receives 64-bit words from row `row` on. Returns the next row,
    the message it stopped at (`to` when none), and how many groups were not reported.
    """
    offset, length, received, slot = messages
    stamp, receipt, first, second = out
    stamped, doubles, first_at, first_mark, second_at, second_mark = shape
    body = 4
    if stamped:
        body = 4 + (12 + frame.shape[0] + 1 + 7) // 8 * 8
    size = body + 8 * doubles
    unreported = 0
    for i in range(span[0], span[1]):
        if slot[i] != wanted:
            continue
        at = offset[i]
        if not is_expected(buffer, at, length[i], size, frame, stamped):
            return row, i, unreported
        receipt[row] = received[i]
        stamp[row] = header_stamp(buffer, at) if stamped else received[i]
        unreported += copy_group(buffer, at + body, first_at, first_mark, first, row)
        unreported += copy_group(buffer, at + body, second_at, second_mark, second, row)
        row += 1
    return row, span[1], unreported
