# SPDX-License-Identifier: Apache-2.0
"""The next experiment that tells two rivals apart, as data and as a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from thermal_comp.data.conditions import Sensor
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.experiment.design import ChamberLimits, design_experiment
from thermal_comp.experiment.plan import FINAL_S, PRECONDITION_S, REFERENCE_C, Plan

from imu_workbench.proposed_profile import profile_content
from imu_workbench.report.figures.measured import curve
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.web.case.version import model_from_text


def next_profile_task(
    progress: Callable[[str], None],
    model_text: str,
    rivals: tuple[str, str],
    limits: ChamberLimits,
    effect_files: Sequence[Path],
    missing: Mapping[Sensor, float],
) -> dict[str, Any]:
    """Return the proposal: what `next-experiment --json` says, the profile file, its set-point.

    `missing` is what either effect has to explain, rms [SI unit].
    """
    progress('searching a profile that separates them')
    catalogue = dict(effect_catalogue(effect_files))
    model = model_from_text(model_text, catalogue)
    proposal = design_experiment(rivals, model, limits, catalogue, seed=0, missing=missing)
    content = profile_content(proposal, rivals, limits)
    return {
        'effects': list(rivals),
        'sensor': proposal.sensor,
        'missing': missing.get(proposal.sensor),
        'evidence_before': float(proposal.evidence_before),
        'evidence_after': float(proposal.evidence_after),
        'separable': bool(proposal.separable),
        'actions': list(proposal.actions),
        'hours': proposal.plan.hours,
        'repeats': proposal.plan.repeats,
        'profile': yaml.safe_dump(content, sort_keys=False, allow_unicode=True),
        'setpoint': setpoint_of(proposal.plan),
    }


def setpoint_of(plan: Plan) -> dict[str, list[float]]:
    """Return the corners of the set-point: hours and °C."""
    time, hours, degrees = PRECONDITION_S, [0.0, PRECONDITION_S / 3600.0], [REFERENCE_C] * 2
    level = REFERENCE_C
    for segment in plan.cycle * plan.repeats:
        time += abs(segment.target - level) / segment.rate * 60.0
        level = segment.target
        hours.append(time / 3600.0)
        degrees.append(level)
        time += segment.dwell
        hours.append(time / 3600.0)
        degrees.append(level)
    hours.append((time + FINAL_S) / 3600.0)
    degrees.append(level)
    return {'x': hours, 'y': degrees}


def profile_figure(setpoint: Mapping[str, Any]) -> Figure:
    """Return the set-point over the run."""
    line = curve(
        setpoint, 'set-point', trace_axes(0), color='@temperature', width=2, showlegend=False,
        hovertemplate='%{y:.1f} °C at %{x:.2f} h<extra></extra>',
    )  # fmt: skip
    spec = figure([line], [Panel('time [h]', 'set-point [°C]')], height=180)
    for part in (spec['layout'], spec['narrow']):
        part['margin'] = part['margin'] | {'t': 12}
    return spec
