# SPDX-License-Identifier: Apache-2.0
"""The part of the residual that one more effect would explain, and its figure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.hypotheses import SensorHypotheses
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.linear.columns import orthonormal, project_out, stack_runs
from thermal_comp.model.values import ModelError
from thermal_comp.noise.of_runs import noise_of_runs
from thermal_comp.presentation.display import DISPLAY_UNITS

from imu_workbench.answer import plain
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.report.series import rounded
from imu_workbench.web.case.tasks import load_runs
from imu_workbench.web.case.version import Version, model_from_text
from imu_workbench.web.case.view import Timeline, View

POINTS = 900


@dataclass(frozen=True, eq=False)
class EffectPreview:
    """The best form of an effect beside a model, fitted to what the model leaves."""

    effect: str
    sensor: str
    evidence: float
    threshold: float
    parameters: Mapping[str, Mapping[str, Any]]
    """Shape parameters: value, unit."""
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
    effect_files: Sequence[Path],
) -> EffectPreview:
    """Return what an effect of the catalogue would explain of one sensor's residual."""
    progress(f'drawing {effect.replace("_", " ")}')
    catalogue = effect_catalogue(effect_files)
    runs = load_runs(prepared)
    model = model_from_text(model_text, catalogue)
    base = tuple(e for e in model.sensors[sensor].effects if e.name != effect)
    noise = model.sensors[sensor].noise or noise_of_runs(runs, sensor)[0]
    design = CandidateDesign(ColumnSource(runs), sensor, noise, base)
    hypotheses = SensorHypotheses(design, {effect: catalogue[effect]})
    if not hypotheses.families:
        raise ModelError(f'{effect} leaves no trace in these runs that could be fitted')
    found = hypotheses.single(hypotheses.families[0])
    best = found.components[0].form.effect
    curves, share = explained_by(best, base, runs, sensor)
    parameters = {
        name: {'value': plain(value), 'unit': best.__dataclass_fields__[name].metadata['unit']}
        for name, value in best.shape_parameters.items()
    }
    evidence = hypotheses.evidence(found.components)
    return EffectPreview(effect, sensor, evidence, 0.0, parameters, curves, share)


def explained_by(
    effect: Effect, base: Sequence[Effect], runs: Sequence[PreparedRun], sensor: Sensor
) -> tuple[dict[str, FloatArray], tuple[float, float, float]]:
    """Return what the effect explains beyond levels and base, per run (m, 3), and its share.

    Ordinary least squares, axis by axis: a picture, not an estimate.
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
        weights = np.linalg.lstsq(new, left, rcond=1e-9)[0]
        curves[good, axis] = new @ weights
        total = float((left**2).sum())
        share.append(float(((new @ weights) ** 2).sum()) / total if total > 0.0 else 0.0)
    by_run = {run.name: curves[edges[r] : edges[r + 1]] for r, run in enumerate(runs)}
    return by_run, (share[0], share[1], share[2])


def _columns(effect: Effect, runs: Sequence[PreparedRun], sensor: Sensor, axis: int) -> FloatArray:
    parts = [run.columns(effect, sensor) for run in runs]
    parts = [part[:, axis] if part.ndim == 3 else part for part in parts]
    return stack_runs(parts, per_run=effect.per_run)


def preview_figure(
    found: EffectPreview, version: Version, view: View, timeline: Timeline
) -> Figure:
    """Return residual and explained part against temperature and over time."""
    unit, factor = DISPLAY_UNITS[view.sensor].unit, DISPLAY_UNITS[view.sensor].factor
    data: list[dict[str, Any]] = []
    x, y, t, fitted = [], [], [], []
    for run in version.blocks:
        start = timeline.start(run.run)
        rows = np.isfinite(run.residual(view.sensor)[:, view.axis])
        x.append(start + run.time[rows] / 3600.0)
        y.append(run.residual(view.sensor)[rows, view.axis] * factor)
        t.append(run.temperature[rows])
        fitted.append(found.curves[run.run][rows, view.axis] * factor)
    time, residual, temperature = np.concatenate(x), np.concatenate(y), np.concatenate(t)
    explained = np.concatenate(fitted)
    every = max(1, len(time) // POINTS)
    name = found.effect.replace('_', ' ')
    for panel, across in ((0, temperature), (1, time)):
        data.append({
            'type': 'scatter', 'mode': 'markers', 'name': 'residual', 'legendgroup': 'residual',
            'showlegend': panel == 0, 'x': rounded(across[::every], 6),
            'y': rounded(residual[::every], 4),
            'marker': {'color': '@raw', 'size': 3.5, 'opacity': 0.55}, 'hoverinfo': 'skip',
            **trace_axes(panel),
        })  # fmt: skip
        data.append({
            'type': 'scatter', 'mode': 'markers', 'name': f'{name}, fitted',
            'legendgroup': 'fitted', 'showlegend': panel == 0,
            'x': rounded(across[::every], 6), 'y': rounded(explained[::every], 4),
            'marker': {'color': f'@{view.axis_name}', 'size': 3.5},
            'hovertemplate': f'{name}: %{{y:.3~g}} {unit}<extra></extra>',
            **trace_axes(panel),
        })  # fmt: skip
    panels = [
        Panel('die temperature [°C]', f'{view.axis_name} [{unit}]'),
        Panel('time [h]', '', title=f'{view.axis_name} [{unit}]'),
    ]
    return figure(data, panels, columns=2, height=220, linked=False)
