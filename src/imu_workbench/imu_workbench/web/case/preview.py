# SPDX-License-Identifier: Apache-2.0
"""The part of the residual that one more effect would explain."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.set_search import best_single
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.linear.columns import orthonormal, project_out, stack_runs
from thermal_comp.model.values import ModelError, ThermalModel
from thermal_comp.noise.of_runs import noise_of_runs

from imu_workbench.answer import plain
from imu_workbench.web.case.candidates import effect_of, error_with
from imu_workbench.web.case.tasks import load_runs
from imu_workbench.web.case.version import model_from_text


@dataclass(frozen=True, eq=False)
class EffectPreview:
    """The best form of an effect beside a model, fitted to what the model leaves."""

    effect: str
    sensor: str
    shape: Mapping[str, Any]
    """Shape parameters of the form."""
    error_after: float
    """Held out, rms over the axes [SI unit]."""
    curves: Mapping[str, FloatArray]
    """(m, 3) per run: the part of the residual it explains [SI unit]."""
    share: tuple[float, float, float]
    """Of the residual's variance, per axis."""


def preview_task(
    progress: Callable[[str], None],
    prepared: Path,
    model_text: str,
    effect: str,
    sensor: Sensor,
    shape: Mapping[str, Any] | None,
    effect_files: Sequence[Path],
) -> EffectPreview:
    """Return what an effect of the catalogue would explain of one sensor's residual.

    `shape`: the form of the effect where it is known; None: the one that explains most.
    """
    progress(f'drawing {effect.replace("_", " ")}')
    catalogue = effect_catalogue(effect_files)
    runs = load_runs(prepared)
    model = model_from_text(model_text, catalogue)
    base = model.sensors[sensor].effects
    best = (
        _best_form(model, runs, effect, sensor, catalogue)
        if shape is None
        else effect_of(effect, shape, catalogue)
    )
    curves, share = explained_by(best, base, runs, sensor)
    after = error_with(model, runs, sensor, best)
    return EffectPreview(
        effect=effect,
        sensor=sensor,
        shape=plain(dict(best.shape_parameters)),
        error_after=after,
        curves=curves,
        share=share,
    )


def _best_form(
    model: ThermalModel,
    runs: Sequence[PreparedRun],
    effect: str,
    sensor: Sensor,
    catalogue: Mapping[str, type[Effect]],
) -> Effect:
    part = model.sensors[sensor]
    noise = part.noise or noise_of_runs(runs, sensor)[0]
    design = CandidateDesign(ColumnSource(runs), sensor, noise, part.effects)
    hypotheses = SensorHypotheses(design, {effect: catalogue[effect]})
    if not hypotheses.families:
        raise ModelError(f'{effect} leaves no trace in these runs that could be fitted')
    return best_single(hypotheses, hypotheses.families[0]).components[0].form.effect


def explained_by(
    effect: Effect, base: Sequence[Effect], runs: Sequence[PreparedRun], sensor: Sensor
) -> tuple[dict[str, FloatArray], tuple[float, float, float]]:
    """Return what the effect explains beyond levels and base, per run (m, 3), and its share.

    Ordinary least squares, axis by axis: for a figure, not as an estimate.
    """
    measured = [run.measured[sensor] for run in runs]
    edges = np.cumsum([0, *(len(rows) for rows in measured)])
    stacked = np.concatenate(measured)
    levels = stack_runs([np.ones((len(rows), 1)) for rows in measured], per_run=True)
    curves = np.full_like(stacked, np.nan)
    share = []
    for axis in range(3):
        known = [levels, *(_columns(e, runs, sensor, axis) for e in base)]
        own = _columns(effect, runs, sensor, axis)
        good = np.isfinite(stacked[:, axis])
        basis = orthonormal(np.column_stack(known)[good])
        left, new = project_out(basis, stacked[good, axis]), project_out(basis, own[good])
        explained = left - project_out(orthonormal(new), left)
        curves[good, axis] = explained
        total = float((left**2).sum())
        share.append(float((explained**2).sum()) / total if total > 0.0 else 0.0)
    by_run = {run.name: curves[edges[r] : edges[r + 1]] for r, run in enumerate(runs)}
    return by_run, (share[0], share[1], share[2])


def _columns(effect: Effect, runs: Sequence[PreparedRun], sensor: Sensor, axis: int) -> FloatArray:
    parts = [run.columns(effect, sensor) for run in runs]
    parts = [part[:, axis] if part.ndim == 3 else part for part in parts]
    return stack_runs(parts, per_run=effect.per_run)
