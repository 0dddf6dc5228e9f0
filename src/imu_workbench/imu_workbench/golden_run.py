# SPDX-License-Identifier: Apache-2.0
"""The numbers a node published for a bag, as a golden file, and the first that differs."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from imu_recording.user_error import UserError

SCHEMA = 1
UNCOMPARED_TOPIC = '/diagnostics'


class GoldenError(UserError):
    """A golden file that cannot be used; the message names it and the way out."""


class ReplayedMessage(Protocol):
    """What a node published."""

    @property
    def received(self) -> int:
        """Bag time at which it was published [ns]."""
        ...

    @property
    def topic(self) -> str:
        """Full name."""
        ...

    def numbers(self) -> dict[str, float]:
        """Return floating-point fields by name."""
        ...


@dataclass(frozen=True, eq=False)
class GoldenColumns:
    """One topic's numbers."""

    time: IntArray
    """(n,) bag time of publication [ns]."""
    names: list[str]
    values: FloatArray
    """(n, fields)."""


@dataclass(frozen=True)
class Drift:
    """The first number that moved."""

    topic: str
    sample: int
    time: int
    field: str
    value: float
    golden: float

    def __str__(self) -> str:
        return (
            f'{self.topic}: sample {self.sample} at {self.time} ns: {self.field} is '
            f'{self.value:.12g}, golden {self.golden:.12g} (moved by '
            f'{abs(self.value - self.golden):.3g})'
        )


def columns_of(messages: Iterable[ReplayedMessage]) -> dict[str, GoldenColumns]:
    """Return the numbers of every topic but diagnostics."""
    rows: dict[str, list[tuple[int, dict[str, float]]]] = {}
    for message in messages:
        if message.topic != UNCOMPARED_TOPIC:
            rows.setdefault(message.topic, []).append((message.received, message.numbers()))
    return {
        topic: GoldenColumns(
            np.array([time for time, _ in entries], dtype=np.int64),
            list(entries[0][1]),
            np.array([list(numbers.values()) for _, numbers in entries]),
        )
        for topic, entries in rows.items()
    }


def write_golden(
    path: Path, columns: Mapping[str, GoldenColumns], made_by: Mapping[str, Any]
) -> None:
    """Write the numbers; `made_by` says how (node, parameters, command)."""
    content = {
        'schema': SCHEMA,
        **made_by,
        'topics': {
            topic: {
                'count': len(c.time),
                'fields': c.names,
                'time': _packed(c.time),
                'values': _packed(c.values),
            }
            for topic, c in columns.items()
        },
    }
    path.write_text(json.dumps(content, indent=1) + '\n', 'utf-8')


def read_golden(path: Path) -> dict[str, GoldenColumns]:
    """Read the numbers; raise GoldenError naming what is wrong."""
    try:
        content = json.loads(path.read_text('utf-8'))
        if content['schema'] != SCHEMA:
            raise GoldenError(
                f'{path}: schema {content["schema"]!r} is not {SCHEMA}: renew with --write-golden'
            )
        return {
            topic: GoldenColumns(
                np.frombuffer(_unpacked(t['time']), np.int64),
                list(t['fields']),
                np.frombuffer(_unpacked(t['values'])).reshape(t['count'], len(t['fields'])),
            )
            for topic, t in content['topics'].items()
        }
    except (json.JSONDecodeError, KeyError, TypeError, zlib.error, UnicodeDecodeError) as error:
        raise GoldenError(
            f'{path} is not a golden file ({error!r}): write one with --write-golden'
        ) from None


def find_drift(
    now: Mapping[str, GoldenColumns], golden: Mapping[str, GoldenColumns], tolerance: float
) -> str | Drift | None:
    """Return the first sample that moved by more than `tolerance`, in time; None where none did.

    A sentence where topics, fields or counts differ and no sample moved before that.
    """
    drifts, structure = [], ''
    for topic in sorted(set(now) | set(golden)):
        if topic not in now or topic not in golden:
            lost = 'not published any more' if topic in golden else 'not in the golden run'
            structure = structure or f'{topic}: {lost}'
            continue
        mine, theirs = now[topic], golden[topic]
        if mine.names != theirs.names:
            structure = structure or f'{topic}: fields differ'
            continue
        drift = _first(topic, mine, theirs, tolerance)
        if drift is not None:
            drifts.append(drift)
        elif len(mine.time) != len(theirs.time):
            structure = structure or (
                f'{topic}: {len(mine.time)} messages, golden {len(theirs.time)}; the first '
                f'{min(len(mine.time), len(theirs.time))} are as they were'
            )
    return min(drifts, key=lambda drift: drift.time) if drifts else structure or None


def _first(
    topic: str, mine: GoldenColumns, theirs: GoldenColumns, tolerance: float
) -> Drift | None:
    n = min(len(mine.time), len(theirs.time))
    apart = np.abs(mine.values[:n] - theirs.values[:n])
    same = (apart <= tolerance) | (np.isnan(mine.values[:n]) & np.isnan(theirs.values[:n]))
    moved = np.flatnonzero(~same.all(axis=1))
    shifted = np.flatnonzero(mine.time[:n] != theirs.time[:n])
    if len(shifted) and (not len(moved) or shifted[0] <= moved[0]):
        i = int(shifted[0])
        times = float(mine.time[i]), float(theirs.time[i])
        return Drift(topic, i, int(mine.time[i]), 'time [ns]', *times)
    if not len(moved):
        return None
    i = int(moved[0])
    k = int(np.flatnonzero(~same[i])[0])
    value, golden = float(mine.values[i, k]), float(theirs.values[i, k])
    return Drift(
        topic=topic,
        sample=i,
        time=int(mine.time[i]),
        field=mine.names[k],
        value=value,
        golden=golden,
    )


def _packed(values: np.ndarray) -> str:
    return base64.b64encode(zlib.compress(np.ascontiguousarray(values).tobytes(), 9)).decode()


def _unpacked(text: str) -> bytes:
    return zlib.decompress(base64.b64decode(text))
