# SPDX-License-Identifier: Apache-2.0
"""Attitude error budget: what each sensor's temperature error costs each filter, in degrees.

A recording is run raw, compensated, and with one sensor compensated at a time; the attitudes are
compared with the true one where the recording has it, else with the fully compensated run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording
from orientation_filters.errors import (
    AttitudeErrors,
    ErrorGroup,
    attitude_errors,
    errors_by_phase,
    errors_by_temperature,
)
from orientation_filters.filters import FILTERS, run_filter, sample_rate, state_bytes
from orientation_filters.rotation.arrays import enu_from_ned
from orientation_filters.upsampling import upsample

CUTOFFS_HZ = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""The paper's typical range, with its choice of 3 Hz."""
LOWEST_RATE_HZ = 50.0
TIMED_ROWS = 20_000


@dataclass(frozen=True)
class Cost:
    """One filter on one variant of the data: rms errors [deg]."""

    filter: str
    preset: str
    data: str
    """'raw', 'compensated' or '<sensor> compensated'."""
    rms: dict[str, float]
    """total, heading, inclination."""
    gain: dict[str, float]
    """How much of the raw error this compensation takes away, each kind."""
    moved: dict[str, float]
    """Rms angle between this run and the raw one: what the temperature error did, whatever else
    is wrong with the device."""
    cutoff_hz: float | None = None


@dataclass(frozen=True)
class Effort:
    """What one filter costs on this machine."""

    filter: str
    preset: str
    nanoseconds_per_sample: float
    state_bytes: int


@dataclass(frozen=True, eq=False)
class Attribution:
    """Everything `orient` answers about one recording."""

    recording: ImuRecording
    against: str
    """'reference orientation' or 'compensated run'."""
    costs: list[Cost]
    sweep: list[Cost]
    """The complementary filter over cut-off frequencies, raw and compensated."""
    efforts: list[Effort]
    groups: dict[str, list[ErrorGroup]]
    """Errors [rad] by phase and temperature: '<filter> <data>' → groups."""


def variants(raw: ImuRecording, compensated: ImuRecording) -> dict[str, ImuRecording]:
    """Return the recording raw, compensated, and with one sensor compensated at a time."""
    made = {'raw': raw, 'compensated': compensated}
    for sensor, field in SENSOR_FIELDS.items():
        change: dict[str, Any] = {field: getattr(compensated, field)}
        made[f'{sensor} compensated'] = replace(raw, **change)
    return made


def attribute(
    raw: ImuRecording,
    compensated: ImuRecording,
    *,
    filters: Sequence[str] = tuple(FILTERS),
    presets: Sequence[str] = ('paper',),
    cutoffs_hz: Sequence[float] = CUTOFFS_HZ,
    progress: Callable[[str], None] = lambda _: None,
    **parameters: Any,
) -> Attribution:
    """Return what temperature costs each filter and what compensation gives back.

    Recordings slower than 50 Hz are interpolated; `notes` of the result's recording say so.
    """
    fast = {name: upsample(r, LOWEST_RATE_HZ) for name, r in variants(raw, compensated).items()}
    measured = fast['raw']
    truth, costs, groups, efforts = measured.reference_orientation, [], {}, []
    for name in filters:
        for preset in presets:
            progress(f'{name}, {preset}')
            options = {**parameters, 'preset': preset}
            runs = {data: _estimate(name, r, options) for data, r in fast.items()}
            reference = runs['compensated'] if truth is None else truth
            errors = {data: attitude_errors(q, reference) for data, q in runs.items()}
            moved = {data: attitude_errors(q, runs['raw']) for data, q in runs.items()}
            costs += _costs(name, preset, errors, moved)
            for data in ('raw', 'compensated'):
                groups[f'{name} {preset} {data}'] = [
                    *errors_by_phase(errors[data], measured),
                    *errors_by_temperature(errors[data], measured),
                ]
            efforts.append(_effort(name, preset, measured, options))
    sweep = list(_sweep(fast, cutoffs_hz, progress, parameters))
    against = 'compensated run' if truth is None else 'reference orientation'
    return Attribution(measured, against, costs, sweep, efforts, groups)


def _estimate(name: str, recording: ImuRecording, options: dict[str, Any]) -> FloatArray:
    """Return the attitude sensor → ENU."""
    q = run_filter(name, recording, **options).orientation
    return enu_from_ned(q) if options.get('world_frame') == 'ned' else q


def _costs(
    name: str,
    preset: str,
    errors: dict[str, AttitudeErrors],
    moved: dict[str, AttitudeErrors],
    cutoff_hz: float | None = None,
) -> list[Cost]:
    raw = _degrees(errors['raw'].rms())
    costs = []
    for data, found in errors.items():
        rms = _degrees(found.rms())
        gain = {kind: raw[kind] - rms[kind] for kind in raw}
        costs.append(Cost(name, preset, data, rms, gain, _degrees(moved[data].rms()), cutoff_hz))
    return costs


def _sweep(
    fast: dict[str, ImuRecording],
    cutoffs_hz: Sequence[float],
    progress: Callable[[str], None],
    parameters: dict[str, Any],
) -> Iterator[Cost]:
    """Give the complementary filter's errors at each cut-off below half the sample rate."""
    truth = fast['raw'].reference_orientation
    options = {k: v for k, v in parameters.items() if k != 'cutoff_hz'}
    for cutoff in cutoffs_hz:
        if cutoff > 0.5 * sample_rate(fast['raw']):
            continue
        progress(f'complementary, {cutoff:g} Hz')
        chosen = {**options, 'preset': 'paper', 'cutoff_hz': cutoff}
        runs = {d: _estimate('complementary', fast[d], chosen) for d in ('raw', 'compensated')}
        reference = runs['compensated'] if truth is None else truth
        errors = {data: attitude_errors(q, reference) for data, q in runs.items()}
        moved = {data: attitude_errors(q, runs['raw']) for data, q in runs.items()}
        yield from _costs('complementary', 'paper', errors, moved, cutoff)


def _effort(name: str, preset: str, recording: ImuRecording, options: dict[str, Any]) -> Effort:
    """Return time per sample (best of three, warm) and the bytes of the state."""
    part = recording.rows(slice(0, TIMED_ROWS))
    spent = []
    for _ in range(3):
        start = time.perf_counter()
        run_filter(name, part, **options)
        spent.append(time.perf_counter() - start)
    return Effort(name, preset, min(spent) / max(len(part), 1) * 1e9, state_bytes(name, preset))


def _degrees(rms: dict[str, float]) -> dict[str, float]:
    return {kind: float(np.degrees(value)) for kind, value in rms.items()}


def content_of(result: Attribution, recording: ImuRecording) -> dict[str, Any]:
    """Return the attribution as plain values, angles in degrees."""
    return {
        'bag': recording.source,
        'device': recording.device,
        'samples': len(result.recording),
        'against': result.against,
        'notes': list(result.recording.notes),
        'unplaced': dict(result.recording.unplaced),
        'costs': [asdict(cost) for cost in result.costs],
        'cutoff_sweep': [asdict(cost) for cost in result.sweep],
        'effort': [asdict(effort) for effort in result.efforts],
        'remarks': remarks(result),
        'groups': {
            name: [_group(group) for group in groups] for name, groups in result.groups.items()
        },
    }


def _group(group: ErrorGroup) -> dict[str, Any]:
    rms = {kind: float(np.degrees(value)) for kind, value in group.rms.items()}
    return {'label': group.label, 'rows': group.rows, 'rms': rms}


def remarks(result: Attribution) -> list[dict[str, Any]]:
    """Return the paper's remarks about the filters, each with our number."""
    by = {(c.filter, c.preset, c.data): c for c in result.costs}
    efforts = {(e.filter, e.preset): e for e in result.efforts}
    rows: list[dict[str, Any]] = []
    ahrs, complementary = (
        by.get(('ahrs', 'paper', 'raw')),
        by.get(('complementary', 'paper', 'raw')),
    )
    if ahrs and complementary:
        both = [by[name, 'paper', 'compensated'] for name in ('ahrs', 'complementary')]
        rows.append(
            {
                'remark': 'AHRS suffers more from temperature',
                'ours': {'ahrs': both[0].moved['total'], 'complementary': both[1].moved['total']},
                'unit': 'deg',
                'holds': both[0].moved['total'] > both[1].moved['total'],
            }
        )
    singles = [c for (f, p, d), c in by.items() if f == 'ahrs' and p == 'paper' and ' ' in d]
    if singles:
        most = max(singles, key=lambda cost: cost.moved['total'])
        rows.append(
            {
                'remark': 'because of the magnetometer',
                'ours': {c.data.split()[0]: c.moved['total'] for c in singles},
                'unit': 'deg',
                'holds': most.data.startswith('magnetometer') and most.moved['total'] > 0,
            }
        )
    if ('ahrs', 'paper') in efforts and ('complementary', 'paper') in efforts:
        a, c = efforts['ahrs', 'paper'], efforts['complementary', 'paper']
        for unit, attribute_name in (('ns', 'nanoseconds_per_sample'), ('B', 'state_bytes')):
            ours = {
                'ahrs': getattr(a, attribute_name),
                'complementary': getattr(c, attribute_name),
            }
            rows.append(
                {
                    'remark': 'AHRS costs more',
                    'ours': ours,
                    'unit': unit,
                    'holds': ours['ahrs'] > ours['complementary'],
                }
            )
    return rows
