# SPDX-License-Identifier: Apache-2.0
"""How much of one device's residual each effect of the catalogue would take up.

The measurement, whitened by the device's noise, is freed of the levels of its runs and of the
line; so are the columns of an effect. The sum of squares that an orthonormal basis of what is left
of the columns takes up is χ² with as many degrees of freedom as columns where the effect is
absent, and that times one plus its share of the information where it is present. Added over
devices it tells what no single one can (`statistics.prevalence`). Of an effect with one column and
one shape parameter, the coefficient in each form is kept too (`statistics.shape_population`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.columns import orthonormal, per_axis
from thermal_comp.linear.projected_rows import ProjectedRows
from thermal_comp.linear.whitening import RowWhitening
from thermal_comp.model.values import NoiseModel

GRID_POINTS = 13
"""Forms of an effect along its shape parameter: close enough to interpolate between them."""
LEAST_COLUMN_SHARE = 1e-3
"""Least share of a whitened column beyond levels and line: below it the runs do not show it."""


@dataclass(frozen=True, eq=False)
class TriedEffect:
    """What the forms of one effect would take up in one sensor."""

    effect: str
    forms: tuple[str, ...]
    """Shape parameters of each form, as text."""
    delta_chi2: FloatArray
    """(forms, 3) fall of χ² with the form: the whitened sum of squares that it takes up."""
    degrees: int
    """Columns of a form on each axis."""
    shapes: tuple[float, ...] = ()
    """The shape parameter of each form, where there is one and it is a number."""
    coefficients: FloatArray | None = None
    """(forms, 3) of an effect with one column."""
    std: FloatArray | None = None
    """(forms, 3) their standard deviations."""


def candidate_effects(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    base: Effect,
    catalogue: Mapping[str, type[Effect]],
) -> list[str]:
    """Return effects of the device that act on each axis alone and whose channels were logged."""
    return [
        name
        for name, effect in catalogue.items()
        if effect.kind == 'device'
        and effect.searched
        and not (effect.coupled or effect.per_run)
        and sensor in effect.sensors
        and not isinstance(base, effect)
        and len(effect().shape_parameters) < 2
        and all(run.conditions.has(channel) for run in runs for channel in effect.channels)
    ]


def try_candidates(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    noise: NoiseModel,
    base: Effect,
    catalogue: Mapping[str, type[Effect]],
) -> list[TriedEffect]:
    """Return what every candidate would take up; one whose axes share coefficients is left out."""
    valid = [run.valid(sensor) for run in runs]
    used = [k for k, rows in enumerate(valid) if rows.sum() > 2]
    if not used:
        return []
    runs, valid = [runs[k] for k in used], [valid[k] for k in used]
    whitening = RowWhitening.of_runs(runs, valid, noise)
    rows = ProjectedRows(whitening, [_columns(runs, valid, sensor, base)[0]])
    values = [run.measured[sensor][ok] for run, ok in zip(runs, valid, strict=True)]
    measured = rows.projected(np.concatenate(values)[:, :, None])[0][:, :, 0]
    found = []
    for name in candidate_effects(runs, sensor, base, catalogue):
        forms, taken = [], []
        for form in catalogue[name].shape_grid(GRID_POINTS):
            own, shared = _columns(runs, valid, sensor, form)
            if shared:
                break
            taken.append(_taken(*rows.projected(own, LEAST_COLUMN_SHARE), measured))
            forms.append(form)
        if forms:
            found.append(_candidate(name, forms, np.array(taken), own.shape[2]))
    return found


def _columns(
    runs: Sequence[PreparedRun],
    valid: Sequence[NDArray[np.bool_]],
    sensor: Sensor,
    effect: Effect,
) -> tuple[FloatArray, bool]:
    """Return the effect's (rows, 3, p) columns over valid rows, and whether axes share them."""
    parts = [run.columns(effect, sensor)[ok] for run, ok in zip(runs, valid, strict=True)]
    return per_axis(np.concatenate(parts))


def _candidate(name: str, forms: Sequence[Effect], taken: FloatArray, degrees: int) -> TriedEffect:
    """`taken` (forms, 3, 3): fall of χ², coefficient and its deviation of each axis."""
    texts = tuple(
        ', '.join(f'{k} {_short(v)}' for k, v in form.shape_parameters.items()) for form in forms
    )
    shapes = tuple(v for form in forms for v in form.shape_parameters.values())
    found = TriedEffect(name, texts, delta_chi2=taken[:, :, 0], degrees=degrees)
    if degrees > 1 or len(forms) < 2 or any(isinstance(v, tuple) for v in shapes):
        return found
    values = tuple(float(v) for v in shapes if not isinstance(v, tuple))
    return replace(found, shapes=values, coefficients=taken[:, :, 1], std=taken[:, :, 2])


def _short(value: float | tuple[float, ...]) -> str:
    return ' '.join(f'{v:.4g}' for v in (value if isinstance(value, tuple) else (value,)))


def _taken(columns: FloatArray, lost: NDArray[np.bool_], measured: FloatArray) -> FloatArray:
    """Return (3, 3) per axis: what columns take up, the first one's coefficient, its deviation.

    NaN where a column is lost: has nothing beyond levels and line.
    """
    found = np.full((3, 3), np.nan)
    for axis in np.flatnonzero(~lost.any(axis=1)):
        own, rest = columns[axis], measured[axis]
        size = float(np.linalg.norm(own[:, 0]))
        taken = orthonormal(own).T @ rest
        found[axis] = taken @ taken, own[:, 0] @ rest / size**2, 1.0 / size
    return found
