# SPDX-License-Identifier: Apache-2.0
"""What of one effect its rival leaves unexplained in runs that are still to be made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.effect import Effect
from thermal_comp.experiment.plan import PERIOD_S
from thermal_comp.linear.whitening import apply_gains, innovation_gains
from thermal_comp.model.values import NoiseModel, ThermalModel

SHAPES = 5
"""Points of the grid over each shape parameter of a rival."""


@dataclass(frozen=True, eq=False)
class Rival:
    """An effect with the size it is expected to have, and its other forms."""

    effect: Effect
    coefficients: FloatArray | None
    """(p, 3) or (runs · p, 3); None: not known yet."""
    forms: tuple[Effect, ...]

    @classmethod
    def of(
        cls, name: str, model: ThermalModel, sensor: Sensor, catalogue: dict[str, type[Effect]]
    ) -> Rival:
        """Return the effect as the model has it, else in its default shape without a size."""
        part = model.sensors[sensor]
        grid = catalogue[name].shape_grid(SHAPES)
        for effect, coefficients in zip(part.effects, part.coefficients, strict=True):
            if effect.name == name:
                return cls(effect, _per_axis(effect, coefficients), (effect, *grid))
        effect = catalogue[name]()
        return cls(effect, None, (effect, *grid))

    def sized(self, bench: PredictedDesign) -> Rival:
        """Return it with a size: without one M = 1 in the runs of the bench."""
        if self.coefficients is not None:
            return self
        columns = bench.raw(self.effect)
        rms: FloatArray = np.sqrt((columns**2).mean(axis=(0, 1)))
        share = np.repeat((1.0 / np.maximum(rms, 1e-300))[:, None], 3, axis=1)
        size = bench.size(np.einsum('nap,pa->na', columns, share))
        one = float(np.sqrt(bench.noise.variance_of_means(1.0).mean()))
        return replace(self, coefficients=share * one / max(size, 1e-300))


def _per_axis(effect: Effect, fitted: FloatArray) -> FloatArray:
    """Return fitted coefficients, of whatever shape, as (p, 3), runs below each other."""
    shared = fitted.ndim == (2 if effect.per_run else 1)
    if shared:
        return np.repeat(fitted.reshape(-1, 1), 3, axis=1)
    return fitted.reshape(-1, 3)


class PredictedDesign:
    """Whitened columns of predicted runs."""

    def __init__(
        self,
        runs: Sequence[Conditions],
        sensor: Sensor,
        noise: NoiseModel,
        base: Sequence[Effect],
    ) -> None:
        self.runs = [run.of(sensor) for run in runs]
        self.noise = noise
        slot: IntArray = np.arange(len(runs[0]), dtype=np.int64)
        self._gains = [innovation_gains(slot, noise, axis, PERIOD_S) for axis in range(3)]
        known = np.concatenate([self._levels(), *(self._columns(e) for e in base)], axis=2)
        self._base = [_orthonormal(known[axis]) for axis in range(3)]

    def evidence(self, truth: Rival, rival: Rival) -> float:
        """Return what of the truth the rival's best form leaves, in whitened sum of squares."""
        raw = self.raw(truth.effect)
        assert truth.coefficients is not None  # noqa: S101 (sized before)
        sizes = np.resize(truth.coefficients, (raw.shape[2], 3))
        signal = np.einsum('nap,pa->na', raw, sizes)
        whitened = self._whitened(signal[:, :, None])[:, :, 0]
        left = [self._without_base(whitened[a][:, None], a)[:, 0] for a in range(3)]
        signal = np.stack(left)
        return min(self._left(signal, form) for form in rival.forms)

    def size(self, signal: FloatArray) -> float:
        """Return the rms (rows, 3) has beyond levels of the runs and a line in temperature."""
        rows = len(self.runs[0])
        parts = [signal[k * rows : (k + 1) * rows] for k in range(len(self.runs))]
        centred = np.concatenate([part - part.mean(axis=0) for part in parts])
        x = np.concatenate([run.temperature - run.temperature.mean() for run in self.runs])
        rest = centred - np.outer(x, x @ centred / (x @ x))
        return float(np.sqrt((rest**2).mean()))

    def _left(self, signal: FloatArray, form: Effect) -> float:
        columns = self._columns(form)
        if form.columns(self.runs[0])[0].ndim == 3:
            stacked = np.concatenate([self._without_base(columns[a], a) for a in range(3)])
            basis = _orthonormal(stacked)
            flat = signal.ravel()
            return float(((flat - basis @ (basis.T @ flat)) ** 2).sum())
        left = 0.0
        for axis in range(3):
            basis = _orthonormal(self._without_base(columns[axis], axis))
            rest = signal[axis] - basis @ (basis.T @ signal[axis])
            left += float((rest**2).sum())
        return left

    def _without_base(self, columns: FloatArray, axis: int) -> FloatArray:
        basis = self._base[axis]
        return np.asarray(columns - basis @ (basis.T @ columns))

    def _levels(self) -> FloatArray:
        runs, rows = len(self.runs), len(self.runs[0])
        levels = np.kron(np.eye(runs), np.ones((rows, 1)))
        return self._whitened(np.repeat(levels[:, None, :], 3, axis=1))

    def _columns(self, effect: Effect) -> FloatArray:
        return self._whitened(self.raw(effect))

    def raw(self, effect: Effect) -> FloatArray:
        """(rows, 3, p) columns of all runs below each other."""
        parts = []
        for number, run in enumerate(self.runs):
            columns: FloatArray = effect.columns(run)[0]
            if columns.ndim == 2:
                columns = np.repeat(columns[:, None, :], 3, axis=1)
            if effect.per_run:
                place = np.zeros((len(self.runs), 1))
                place[number] = 1.0
                spread = np.kron(place.T, columns.reshape(len(columns) * 3, -1))
                columns = np.asarray(spread.reshape(len(columns), 3, -1), dtype=np.float64)
            parts.append(np.asarray(columns, dtype=np.float64))
        return np.concatenate(parts)

    def _whitened(self, columns: FloatArray) -> FloatArray:
        rows = len(self.runs[0])
        parts = [columns[k * rows : (k + 1) * rows] for k in range(len(self.runs))]
        return np.stack(
            [
                np.concatenate([apply_gains(part[:, axis], self._gains[axis]) for part in parts])
                for axis in range(3)
            ]
        )


def _orthonormal(columns: FloatArray) -> FloatArray:
    size = np.linalg.norm(columns, axis=0)
    kept = columns[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    if not kept.shape[1]:
        return np.zeros((len(columns), 0))
    left, weights, _ = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), full_matrices=False)
    return np.asarray(left[:, weights > 1e-7 * weights[0]])
