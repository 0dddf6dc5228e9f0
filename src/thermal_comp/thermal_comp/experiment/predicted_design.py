# SPDX-License-Identifier: Apache-2.0
"""The part of one effect that its rival leaves unexplained in runs that are yet to be made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.effect import Effect
from thermal_comp.experiment.plan import PERIOD_S
from thermal_comp.linear.columns import orthonormal, project_out, stack_runs
from thermal_comp.linear.projected_rows import ProjectedRows
from thermal_comp.linear.whitening import RowWhitening
from thermal_comp.model.values import NoiseModel, ThermalModel

SHAPE_GRID_POINTS = 5
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
        grid = catalogue[name].shape_grid(SHAPE_GRID_POINTS)
        for effect, coefficients in zip(part.effects, part.coefficients, strict=True):
            if effect.name == name:
                return cls(effect, _per_axis(effect, coefficients), (effect, *grid))
        effect = catalogue[name]()
        return cls(effect, None, (effect, *grid))

    def sized(self, design: PredictedDesign, missing: float | None = None) -> Rival:
        """Return it with a size, of rms `missing` or else of the noise, where it has none yet."""
        if self.coefficients is not None:
            return self
        columns = design.raw(self.effect)
        rms: FloatArray = np.sqrt((columns**2).mean(axis=(0, 1)))
        share = np.repeat((1.0 / np.maximum(rms, 1e-300))[:, None], 3, axis=1)
        size = design.size(np.einsum('nap,pa->na', columns, share))
        wanted = missing or float(np.sqrt(design.noise.variance_of_means(1.0).mean()))
        return replace(self, coefficients=share * wanted / max(size, 1e-300))


def _per_axis(effect: Effect, fitted: FloatArray) -> FloatArray:
    """Return fitted coefficients, of whatever shape, as (p, 3), runs below each other."""
    shared = fitted.ndim == (2 if effect.per_run else 1)
    if shared:
        return np.repeat(fitted.reshape(-1, 1), 3, axis=1)
    return fitted.reshape(-1, 3)


class PredictedDesign:
    """Whitened columns of predicted runs, orthogonal to levels and the rest of a model."""

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
        whitening = RowWhitening([slot] * len(runs), [noise] * len(runs), [PERIOD_S] * len(runs))
        self._rows = ProjectedRows(whitening, [self.raw(effect) for effect in base])

    def raw(self, effect: Effect) -> FloatArray:
        """Return (rows, 3, p) columns of all runs below each other."""
        parts = [effect.columns(run)[0] for run in self.runs]
        three = [np.repeat(c[:, None], 3, axis=1) if c.ndim == 2 else c for c in parts]
        return stack_runs(three, per_run=effect.per_run)

    def evidence(self, truth: Rival, rival: Rival) -> float:
        """Return the whitened sum of squares of the truth that the rival's best form leaves."""
        raw = self.raw(truth.effect)
        assert truth.coefficients is not None  # noqa: S101 (sized before)
        sizes = np.resize(truth.coefficients, (raw.shape[2], 3))
        signal = self._beyond_base(np.einsum('nap,pa->na', raw, sizes)[:, :, None])[:, :, 0]
        return min(self._sum_left(signal, form) for form in rival.forms)

    def size(self, signal: FloatArray) -> float:
        """Return the rms of (rows, 3) beyond levels of the runs and a line in temperature."""
        parts = np.split(signal, self._rows.whitening.edges[1:-1])
        centred = np.concatenate([part - part.mean(axis=0) for part in parts])
        x = np.concatenate([run.temperature - run.temperature.mean() for run in self.runs])
        rest = centred - np.outer(x, x @ centred / (x @ x))
        return float(np.sqrt((rest**2).mean()))

    def _sum_left(self, signal: FloatArray, form: Effect) -> float:
        """Return the sum of squares of a signal (3, rows) that a form leaves."""
        columns = self._beyond_base(self.raw(form))
        if form.columns(self.runs[0])[0].ndim == 3:  # the axes share its coefficients
            signal, columns = signal.reshape(1, -1), columns.reshape(1, signal.size, -1)
        pairs = zip(signal, columns, strict=True)
        return sum(float((project_out(orthonormal(c), s) ** 2).sum()) for s, c in pairs)

    def _beyond_base(self, columns: FloatArray) -> FloatArray:
        """Return columns (rows, 3, p) whitened, (3, rows, p), zero where the base holds them."""
        left, lost = self._rows.projected(columns)
        return np.where(lost[:, None], 0.0, left)
