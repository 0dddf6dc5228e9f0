# SPDX-License-Identifier: Apache-2.0
"""What a linear thermal model leaves of a signal: how much of a law a campaign can show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from independent_simulator.device import Rows
from independent_simulator.surroundings import Array


class Projection:
    """What a level per run and one line in the recorded temperature do not explain.

    Rows faster than one a second are first averaged over whole seconds.
    """

    def __init__(self, rows: Sequence[Rows], temperatures: Sequence[Array]) -> None:
        self._seconds: list[Array | None] = []
        for row in rows:
            whole = row.time.astype(int)
            fast = len(row.time) > 2 and float(np.median(np.diff(row.time))) < 0.9
            self._seconds.append(np.unique(whole, return_inverse=True)[1] if fast else None)
        x = self._levelled(temperatures)
        self._line = x / max(float(np.linalg.norm(x)), 1e-12)

    def _averaged(self, signal: Array, number: int) -> Array:
        seconds = self._seconds[number]
        if seconds is None:
            return signal
        count = np.bincount(seconds)
        flat = signal.reshape(len(signal), -1).T
        means = np.stack([np.bincount(seconds, weights=column) / count for column in flat], 1)
        return means.reshape(len(count), *signal.shape[1:])

    def _levelled(self, signals: Sequence[Array]) -> Array:
        means = [self._averaged(signal, number) for number, signal in enumerate(signals)]
        return np.concatenate([one - one.mean(0) for one in means])

    def __call__(self, signals: Sequence[Array]) -> Array:
        """Return what remains of (n, …) signals of every run, all runs one below the other."""
        y = self._levelled(signals)
        return y - np.multiply.outer(self._line, self._line @ y)

    def visible(self, signals: Sequence[Array]) -> float:
        """Return the share that remains, of all channels; 0 for what only rounding moves."""
        whole = float(np.linalg.norm(self._levelled(signals)))
        size = max(float(np.abs(signal).max()) for signal in signals)
        return float(np.linalg.norm(self(signals))) / whole if whole > 1e-6 * size else 0.0
