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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.columns import orthonormal, per_axis, project_out, stack_runs
from thermal_comp.linear.whitening import RowWhitening
from thermal_comp.model.values import NoiseModel

GRID_POINTS = 13
"""Forms of an effect along its shape parameter: close enough to interpolate between them."""
LEAST_SHARE = 1e-3
"""Least share of a whitened column beyond levels and line: below it the runs do not show it."""


@dataclass(frozen=True, eq=False)
class CandidateGain:
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


def candidate_effects(runs: Sequence[PreparedRun], sensor: Sensor, base: Effect) -> list[str]:
    """Return effects of the device that act on each axis alone and whose channels were logged."""
    return [
        name
        for name, effect in EFFECTS.items()
        if effect.kind == 'device'
        and effect.searched
        and not (effect.coupled or effect.per_run)
        and sensor in effect.sensors
        and not isinstance(base, effect)
        and len(effect().shape_parameters) < 2
        and all(run.conditions.has(channel) for run in runs for channel in effect.channels)
    ]


def candidate_gains(
    runs: Sequence[PreparedRun], sensor: Sensor, noise: NoiseModel, base: Effect
) -> list[CandidateGain]:
    """Return the gain of every candidate; one whose axes share coefficients is left out."""
    valid = [np.isfinite(run.measured[sensor]).all(axis=1) for run in runs]
    used = [k for k, rows in enumerate(valid) if rows.sum() > 2]
    if not used:
        return []
    runs, valid = [runs[k] for k in used], [valid[k] for k in used]
    whitening = RowWhitening(
        [run.slot[rows] for run, rows in zip(runs, valid, strict=True)],
        noise,
        [run.period for run in runs],
    )

    def columns(effect: Effect) -> tuple[FloatArray, bool]:
        return per_axis(
            np.concatenate(
                [run.columns(effect, sensor)[rows] for run, rows in zip(runs, valid, strict=True)]
            )
        )

    levels = stack_runs([np.ones((int(rows.sum()), 3, 1)) for rows in valid], per_run=True)
    known = np.concatenate([levels, columns(base)[0]], axis=2)
    basis = [orthonormal(axis) for axis in whitening.whitened(known)]
    measured = np.concatenate(
        [run.measured[sensor][rows] for run, rows in zip(runs, valid, strict=True)]
    )
    rest = [
        project_out(q, y)[:, 0]
        for q, y in zip(basis, whitening.whitened(measured[:, :, None]), strict=True)
    ]
    found = []
    for name in candidate_effects(runs, sensor, base):
        forms, taken = [], []
        for form in EFFECTS[name].shape_grid(GRID_POINTS):
            own, shared = columns(form)
            if shared:
                break
            white = whitening.whitened(own)
            taken.append([_taken(q, c, y) for q, c, y in zip(basis, white, rest, strict=True)])
            forms.append(form)
        if forms:
            found.append(_candidate(name, forms, np.array(taken), own.shape[2]))
    return found


def _candidate(
    name: str, forms: Sequence[Effect], taken: FloatArray, degrees: int
) -> CandidateGain:
    """`taken` (forms, 3, 3): fall of χ², coefficient and its deviation of each axis."""
    texts = tuple(
        ', '.join(f'{k} {_short(v)}' for k, v in form.shape_parameters.items()) for form in forms
    )
    shapes = tuple(v for form in forms for v in form.shape_parameters.values())
    found = CandidateGain(name, texts, delta_chi2=taken[:, :, 0], degrees=degrees)
    if degrees > 1 or len(forms) < 2 or any(isinstance(v, tuple) for v in shapes):
        return found
    values = tuple(float(v) for v in shapes if not isinstance(v, tuple))
    return replace(found, shapes=values, coefficients=taken[:, :, 1], std=taken[:, :, 2])


def _short(value: float | tuple[float, ...]) -> str:
    return ' '.join(f'{v:.4g}' for v in (value if isinstance(value, tuple) else (value,)))


def _taken(basis: FloatArray, columns: FloatArray, rest: FloatArray) -> tuple[float, float, float]:
    """Return what whitened columns take up, the first one's coefficient and its deviation.

    NaN where a column has nothing beyond the basis.
    """
    beyond = project_out(basis, columns)
    size = np.linalg.norm(beyond, axis=0)
    if (size <= LEAST_SHARE * np.linalg.norm(columns, axis=0)).any():
        return np.nan, np.nan, np.nan
    taken = orthonormal(beyond).T @ rest
    return float(taken @ taken), float(beyond[:, 0] @ rest / size[0] ** 2), float(1.0 / size[0])
