# SPDX-License-Identifier: Apache-2.0
"""Whiten block means under a noise model: the innovations of its Kalman filter, exact at gaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.model.values import NoiseModel


@dataclass(frozen=True, eq=False)
class Gains:
    """What the filter does at each of m block means; it depends on their places alone."""

    decay: FloatArray
    """(k,) decay of each process over one block."""
    weight: FloatArray
    """(k,) weight of a process at a block's start in the mean over it."""
    missed: FloatArray
    """(m, k) decay of each process over the missing blocks before."""
    gain: FloatArray
    """(m, k) share of the innovation each process takes up."""
    deviation: FloatArray
    """(m,) standard deviation of the innovation [unit]."""

    def since(self, row: int) -> Gains:
        """Return the filter from a row on, for what is zero before it."""
        rows = slice(row, None)
        return replace(
            self, missed=self.missed[rows], gain=self.gain[rows], deviation=self.deviation[rows]
        )


def innovation_gains(
    slot: IntArray,
    noise: NoiseModel,
    axis: int,
    period: float,
    vibration: FloatArray | None = None,
) -> Gains:
    """Return the gains for block means at `slot`; worth keeping where many columns follow.

    The filter's states are the processes at the start of a block. With r = T / τ of a process x
    of variance σ², the mean over the block is a·x plus what is left, x_end = φ·x plus what is
    left: φ = e^{−r}, a = (1 − φ) / r, Cov(left, left) = σ² (1 − φ)² / r between the two,
    Var(mean − a·x) = σ² (2 r − 3 + 4 φ − φ²) / r². `vibration` (m,) of each block adds to that.
    """
    variance = noise.amplitudes[:, axis] ** 2
    r = period / noise.time_constants
    decay = np.exp(-r)
    weight = -np.expm1(-r) / r
    shared = variance * np.expm1(-r) ** 2 / r
    series = 2.0 * r / 3.0 - r**2 / 2.0 + 7.0 * r**3 / 30.0
    exact = (2.0 * r - 3.0 + 4.0 * decay - decay**2) / r**2
    left = float(variance @ np.where(r < 1e-2, series, exact) + noise.white[axis] ** 2 / period)
    between = np.diff(slot, prepend=slot[:1] - 1) - 1
    missed = decay ** between[:, None]
    gain = np.empty_like(missed)
    deviation = np.empty(len(missed))
    added = noise.added_by(vibration, period)[:, axis]
    alone = np.full(len(slot), left) + added
    _fill_gains(decay, weight, variance, shared, alone, missed, gain, deviation)
    return Gains(decay, weight, missed, gain, deviation)


def apply_gains(values: FloatArray, gains: Gains) -> FloatArray:
    """Return the whitened rows (m, q)."""
    columns = np.array(values.T, dtype=np.float64, order='C')
    _whiten(columns, 0, gains)
    return np.ascontiguousarray(columns.T)


def _whiten(columns: FloatArray, start: int, gains: Gains) -> None:
    """Whiten the m rows from `start` on of columns (q, rows), each of which lies contiguously."""
    g = gains
    _innovate(columns, start, g.decay, g.weight, g.missed, g.gain, g.deviation)


def apply_transposed(values: FloatArray, gains: Gains) -> FloatArray:
    """Return Wᵀ @ values, (m, q), where W is the filter: S⁻¹ x = Wᵀ W x."""
    turned = np.array(values, dtype=np.float64, order='C')
    after = np.zeros((len(gains.decay), turned.shape[1]))
    _turn(turned, after, gains.decay, gains.weight, gains.missed, gains.gain, gains.deviation)
    return turned


class RowWhitening:
    """Whitening of rows of several runs that stand below each other, by each axis's noise."""

    def __init__(
        self,
        slots: Sequence[IntArray],
        noises: Sequence[NoiseModel],
        periods: Sequence[float],
        vibrations: Sequence[FloatArray | None] | None = None,
    ) -> None:
        """`slots` are the places of each run's rows; runs may share an array of them, or a noise.

        `vibrations` (m,) are those of the rows of each run, None where they are not known.
        """
        self.edges = np.concatenate([[0], np.cumsum([len(slot) for slot in slots])])
        gains: dict[tuple[int, int, float, int], list[Gains]] = {}
        self._gains = []
        shaken = [None] * len(slots) if vibrations is None else vibrations
        for slot, noise, period, vibration in zip(slots, noises, periods, shaken, strict=True):
            key = id(slot), id(noise), period, id(vibration)
            if key not in gains:
                gains[key] = [
                    innovation_gains(slot, noise, axis, period, vibration) for axis in range(3)
                ]
            self._gains.append(gains[key])

    @classmethod
    def of_runs(
        cls,
        runs: Sequence[PreparedRun],
        rows: Sequence[NDArray[np.bool_]],
        noise: NoiseModel,
    ) -> RowWhitening:
        """Return the whitening of some blocks of each run by the noise of a sensor."""
        pairs = list(zip(runs, rows, strict=True))
        return cls(
            [run.slot[taken] for run, taken in pairs],
            [noise.of_run(run.name) for run in runs],
            [run.period for run in runs],
            [None if run.vibration is None else run.vibration[taken] for run, taken in pairs],
        )

    def __len__(self) -> int:
        return int(self.edges[-1])

    @property
    def log_deviations(self) -> float:
        """Sum of ln of the innovations' deviations: ½ ln det of the covariance of the noise."""
        return float(sum(np.log(g.deviation).sum() for gains in self._gains for g in gains))

    def rows_of(self, run: int) -> slice:
        """Return where the rows of a run stand."""
        return slice(int(self.edges[run]), int(self.edges[run + 1]))

    def gains_of(self, run: int, axis: int) -> Gains:
        """Return the filter of one axis of a run."""
        return self._gains[run][axis]

    def of_run(self, values: FloatArray, run: int, axis: int) -> FloatArray:
        """Return values (m, q) of one axis over a run's rows whitened."""
        return apply_gains(values, self._gains[run][axis])

    def whitened(self, columns: FloatArray) -> FloatArray:
        """Return columns (rows, 3, p) whitened, (3, rows, p)."""
        whitened = np.empty((3, len(self), columns.shape[2]))
        for run, gains in enumerate(self._gains):
            rows = self.rows_of(run)
            for axis in range(3):
                whitened[axis, rows] = apply_gains(columns[rows, axis], gains[axis])
        return whitened

    def whiten_in_place(self, columns: FloatArray, axis: int) -> None:
        """Whiten columns (p, rows) of one axis, each of which lies contiguously."""
        for start, gains in zip(self.edges[:-1].tolist(), self._gains, strict=True):
            _whiten(columns, start, gains[axis])


# The kernels are plain loops over scalars that fill arrays made outside: what numpy does inside
# a kernel (outer products, sums over an axis) takes numba ten times as long to compile and runs
# slower.


@njit(cache=True, nogil=True)
def _fill_gains(
    decay: FloatArray,
    weight: FloatArray,
    variance: FloatArray,
    shared: FloatArray,
    left: FloatArray,
    missed: FloatArray,
    gain: FloatArray,
    deviation: FloatArray,
) -> None:
    order = decay.shape[0]
    covariance = np.zeros((order, order))
    for i in range(gain.shape[0]):
        for j in range(order):
            kept = missed[i, j] if i > 0 else 0.0
            for k in range(order):
                covariance[j, k] *= kept * missed[i, k]
            covariance[j, j] += variance[j] * (1.0 - kept * kept)
        spread = left[i]
        for j in range(order):
            seen = 0.0
            for k in range(order):
                seen += covariance[j, k] * weight[k]
            gain[i, j] = decay[j] * seen + shared[j]
            spread += weight[j] * seen
        for j in range(order):
            gain[i, j] /= spread
        for j in range(order):
            for k in range(order):
                covariance[j, k] *= decay[j] * decay[k]
                covariance[j, k] -= gain[i, j] * gain[i, k] * spread
            covariance[j, j] += variance[j] * (1.0 - decay[j] * decay[j])
        deviation[i] = math.sqrt(spread)


@njit(cache=True, nogil=True)
def _innovate(
    columns: FloatArray,
    start: int,
    decay: FloatArray,
    weight: FloatArray,
    missed: FloatArray,
    gain: FloatArray,
    deviation: FloatArray,
) -> None:
    # Four columns at a time stay in registers; the last one stands in for those that are lacking.
    last = columns.shape[0] - 1
    state = np.empty((len(decay), 4))
    for a in range(0, last + 1, 4):
        b, c, d = min(a + 1, last), min(a + 2, last), min(a + 3, last)
        state[:] = 0.0
        for i in range(len(deviation)):
            row = start + i
            at_a, at_b, at_c, at_d = (
                columns[a, row],
                columns[b, row],
                columns[c, row],
                columns[d, row],
            )
            for j in range(len(decay)):
                kept, share = missed[i, j], weight[j]
                of_a, of_b = kept * state[j, 0], kept * state[j, 1]
                of_c, of_d = kept * state[j, 2], kept * state[j, 3]
                state[j, 0], state[j, 1], state[j, 2], state[j, 3] = of_a, of_b, of_c, of_d
                at_a -= share * of_a
                at_b -= share * of_b
                at_c -= share * of_c
                at_d -= share * of_d
            for j in range(len(decay)):
                kept, share = decay[j], gain[i, j]
                state[j, 0] = kept * state[j, 0] + share * at_a
                state[j, 1] = kept * state[j, 1] + share * at_b
                state[j, 2] = kept * state[j, 2] + share * at_c
                state[j, 3] = kept * state[j, 3] + share * at_d
            spread = deviation[i]
            columns[a, row], columns[b, row] = at_a / spread, at_b / spread
            columns[c, row], columns[d, row] = at_c / spread, at_d / spread


@njit(cache=True, nogil=True)
def _turn(
    rows: FloatArray,
    after: FloatArray,
    decay: FloatArray,
    weight: FloatArray,
    missed: FloatArray,
    gain: FloatArray,
    deviation: FloatArray,
) -> None:
    order, width = after.shape
    for i in range(rows.shape[0] - 1, -1, -1):
        for c in range(width):
            rows[i, c] /= deviation[i]
        for j in range(order):
            for c in range(width):
                rows[i, c] += gain[i, j] * after[j, c]
        for j in range(order):
            for c in range(width):
                after[j, c] = missed[i, j] * (decay[j] * after[j, c] - weight[j] * rows[i, c])
