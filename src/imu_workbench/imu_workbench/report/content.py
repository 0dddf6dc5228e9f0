# SPDX-License-Identifier: Apache-2.0
"""Everything the report says, as plain values: what --json writes and the page presents."""

from __future__ import annotations

import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from orientation_filters.filters import state_bytes

from imu_workbench.answer import plain
from imu_workbench.report.analysis import Analysis, RunAnalysis
from imu_workbench.report.attitude import FilterAttitude
from imu_workbench.report.certificate.content import certificates
from imu_workbench.report.claims.attitude import attitude_claims
from imu_workbench.report.claims.claim import Claim
from imu_workbench.report.claims.model import gaussianity_claim, linearity_claim
from imu_workbench.report.claims.thermal import (
    device_claim,
    orientation_claim,
    overheating_claim,
    pooled_claim,
    range_claim,
    slope_table,
)
from imu_workbench.report.error_steps import error_steps_content
from imu_workbench.report.laboratory import Laboratory
from imu_workbench.report.limits import CoefficientLimits
from imu_workbench.report.measured import (
    PAPER_TABLES,
    cycle_content,
    overall_ranges,
    overheating_content,
    plan_content,
    published_statistics,
    recording_content,
    statistics_content,
)
from imu_workbench.report.model_content import model_content
from imu_workbench.report.modelled import dependence_content, fit_content, residual_content
from imu_workbench.report.series import rounded
from imu_workbench.tables import paper
from imu_workbench.tables.paper import PAPER_NOTES, PAPER_PROFILE

TITLE = 'Temperature error of MEMS IMUs'
ALL_RUNS_POINTS = 4_500
"""Points of one channel's lines over all runs together: the page stays small."""


def report_content(
    analysis: Analysis,
    *,
    commands: Sequence[str],
    versions: dict[str, str],
    growth: Mapping[str, Any] | None = None,
    laboratory: Laboratory | None = None,
    limits: CoefficientLimits | None = None,
) -> dict[str, Any]:
    """Return the content of a report; `commands` and `versions` say how it was made.

    `growth` is what a ModelGrowthTask found. `laboratory` and `limits` are what the certificates
    state and decide by; without them they say that nothing was stated.
    """
    points = int(np.clip(ALL_RUNS_POINTS / max(1, len(analysis.runs)), 400, 1500))
    measured = measured_content(analysis, points)
    modelled = modelled_content(analysis, points)
    content = {
        'schema': 1,
        'title': TITLE,
        'lead': lead(analysis),
        'certificates': certificates(analysis, laboratory or Laboratory(), limits),
        'follows_paper': follows_paper(analysis),
        'devices': device_rows(analysis),
        'left_out': list(analysis.left_out),
        **measured,
        **modelled,
        'diagnosis': dict(analysis.diagnoses),
        'staircase': error_steps_content(analysis),
        'attitudes': [attitude_content(run) for run in analysis.runs if run.attitudes],
        'published_attitudes': list(paper.tables_6_7()),
        'claims': report_claims(analysis, measured, modelled),
        'paper_notes': list(PAPER_NOTES),
        'growth': growth,
        'reproduce': {'commands': list(commands), 'versions': versions},
    }
    result: dict[str, Any] = plain(content)
    return result


def follows_paper(analysis: Analysis) -> bool:
    """Tell whether any run followed the paper's plan."""
    return any(run.recording.profile.startswith(PAPER_PROFILE) for run in analysis.runs)


def device_rows(analysis: Analysis) -> list[dict[str, str]]:
    """Return the name of every device, why it has no model, and what was remarked of it."""
    return [{'name': d.name, 'problem': d.problem, 'note': d.note} for d in analysis.devices]


def measured_content(analysis: Analysis, points: int) -> dict[str, Any]:
    """Return what was measured: every recording, Tables III–V and the overall ranges."""
    statistics = [
        {
            'name': run.name,
            'device': run.device,
            'published': published_table(run),
            'sensors': statistics_content(run.recording, run.kept),
        }
        for run in analysis.runs
    ]
    return {
        'recordings': [recording_entry(run, points) for run in analysis.runs],
        'device_of_run': {run.name: run.device for run in analysis.runs},
        'statistics': statistics,
        'published_statistics': published_statistics(),
        'ranges': overall_ranges(statistics),
    }


def recording_entry(run: RunAnalysis, points: int) -> dict[str, Any]:
    """Return one recording: its identity, its plan, one cycle, how much warmer than the air."""
    return recording_content(run.recording, run.hash) | {
        'name': run.name,
        'plan': plan_content(run.recording, points=points),
        'cycle': cycle_content(run.recording, points=points),
        'overheating': overheating_content(run.recording) or {},
    }


def modelled_content(analysis: Analysis, points: int) -> dict[str, Any]:
    """Return what the models make of it: dependence, slopes, fits, residuals, comparison."""
    errors = {run.name: run.errors for run in analysis.runs if run.errors}
    device_of_run = {run.name: run.device for run in analysis.runs}
    return {
        'dependence': {
            device.name: dependence_content(
                [found for run, found in errors.items() if device_of_run[run] == device.name]
            )
            for device in analysis.devices
            if device.model
        },
        'slopes': slope_table(analysis.slopes),
        'pooled': {sensor: test.to_dict() for sensor, test in analysis.pooling.items()},
        'fits': {run: fit_content(found) for run, found in errors.items()},
        'residuals': {
            run: residual_content(found, floors_of(analysis, device_of_run[run]), points=points)
            for run, found in errors.items()
        },
        'comparison': {
            device.name: device.comparison.to_dict()
            for device in analysis.devices
            if device.comparison
        },
        'models': {
            name: model_content(certified.model) for name, certified in analysis.certified.items()
        },
    }


def floors_of(analysis: Analysis, device: str) -> dict[str, FloatArray]:
    """Return the noise floor (3,) of each sensor of a device, in SI units."""
    compared = next(d.comparison for d in analysis.devices if d.name == device)
    parts = compared.sensors.items() if compared else ()
    return {sensor: part.noise_floor for sensor, part in parts}


def report_claims(
    analysis: Analysis, measured: Mapping[str, Any], modelled: Mapping[str, Any]
) -> list[Claim]:
    """Return every claim of the paper beside what was measured and modelled here."""
    filtered = [run for run in analysis.runs if run.attitudes]
    fast = [run for run in filtered if not run.interpolated]
    attitudes = {run.name: run.attitudes for run in fast or filtered}
    overheating = {row['name']: row['overheating'] for row in measured['recordings']}
    memory = {name: state_bytes(name) for name in ('complementary', 'ahrs')}
    return [
        range_claim(measured['ranges']),
        orientation_claim(analysis.slopes),
        device_claim(analysis.slopes),
        pooled_claim(modelled['pooled']),
        linearity_claim(analysis),
        gaussianity_claim(analysis),
        *attitude_claims(attitudes, memory, interpolated=not fast),
        overheating_claim({name: found for name, found in overheating.items() if found}),
    ]


def attitude_content(run: RunAnalysis) -> dict[str, Any]:
    """Return statistics of every filter and data, and the Euler angles over time."""
    series: dict[str, dict[str, Any]] = {}
    for found in run.attitudes:
        if found.data in ('raw', 'compensated'):
            place = series.setdefault(found.filter, {})
            place[found.data] = angle_series(found)
    period = np.diff(run.recording.stamp)
    return {
        'name': run.name,
        'device': run.device,
        'rate_hz': float(1e9 / np.median(period)) if len(period) else None,
        'interpolated': run.interpolated,
        'filters': [
            {
                'filter': found.filter,
                'data': found.data,
                'statistics': found.statistics,
                'nanoseconds_per_sample': found.nanoseconds_per_sample,
                'flags': dict(found.flags),
            }
            for found in run.attitudes
        ],
        'series': series,
    }


def angle_series(attitude: FilterAttitude) -> dict[str, Any]:
    """Return yaw, pitch and roll over time as lines."""
    return {
        name: {'x': rounded(attitude.hours[name]), 'y': rounded(values, 4)}
        for name, values in attitude.lines.items()
    }


def published_table(run: RunAnalysis) -> str:
    """Return the paper's table that shows a device in the run's orientation, '' for none."""
    up = run.recording.up_axis.lstrip('+-')
    return next((name for name, (_, axis) in PAPER_TABLES.items() if axis == up), '')


def lead(analysis: Analysis) -> str:
    """Return what the report is about, in one sentence."""
    names = ', '.join(device.name for device in analysis.devices)
    profiles = sorted({run.recording.profile for run in analysis.runs if run.recording.profile})
    plan = f' through {", ".join(profiles)}' if profiles else ''
    attitude = ', and what that does to the attitude' * any(run.attitudes for run in analysis.runs)
    return (
        f'{names}{plan}: what temperature does to gyroscope, accelerometer and magnetometer, how '
        f'much of it the model removes{attitude}.'
    )


PACKAGES = ('imu_workbench', 'numpy', 'scipy', 'numba', 'rosbags', 'plotly', 'GTC')


def versions() -> dict[str, str]:
    """Return the versions of Python, this package and the libraries that compute."""
    found = {'Python': platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = 'not installed'
    return found


def command_line() -> str:
    """Return the command that is running, as one types it."""
    return shlex.join(['python', '-m', 'imu_workbench', *sys.argv[1:]])
