# SPDX-License-Identifier: Apache-2.0
"""Attitude error budget: what each sensor's temperature error costs each filter, in degrees.

A recording is run raw, compensated, and with one sensor compensated at a time; the attitudes are
compared with the true one where the recording has it, else with the fully compensated run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording
from orientation_filters.errors import (
    ERROR_KINDS,
    AttitudeErrors,
    ErrorGroup,
    attitude_errors,
    errors_by_phase,
    errors_by_temperature,
)
from orientation_filters.filters import FILTERS, run_filter, sample_rate, state_bytes
from orientation_filters.rotation.arrays import enu_from
from orientation_filters.smoothing import run_smoother
from orientation_filters.upsampling import upsample
from thermal_comp.compensation.recording import plan_of, sensor_error
from thermal_comp.data.conditions import field_conditions
from thermal_comp.model.values import ThermalModel
from thermal_comp.presentation.display import FILTER_LABELS

CUTOFFS_HZ = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""The paper's typical range, with its choice of 3 Hz."""
LOWEST_RATE_HZ = 50.0
SMOOTHED = 'smoothed'
"""In place of a preset: `robust`, run forward and backward."""
TIMED_ROWS = 20_000
TRUE_ATTITUDE = 'reference orientation'
NO_TRUTH = (
    'angle [°] between each run and the raw one; there is no true attitude (topic '
    'reference/orientation), so nothing is said of errors'
)
LEAST_WORSE_DEG = 0.02
"""Least increase of an angle's error that is reported [deg]."""
TEN_MINUTES_S = 600.0


@dataclass(frozen=True)
class Cost:
    """One filter on one variant of the data: rms errors [deg]."""

    filter: str
    preset: str
    data: str
    """'raw', 'compensated' or '<sensor> compensated'."""
    rms: dict[str, float]
    """By kind: total, heading, inclination."""
    gain: dict[str, float]
    """Raw error minus `rms`, by kind."""
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
class AttitudeBudget:
    """Attitude errors of one recording by filter and by what is compensated."""

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


def attitude_budget(
    raw: ImuRecording,
    compensated: ImuRecording,
    *,
    filters: Sequence[str] = tuple(FILTERS),
    presets: Sequence[str] = ('paper',),
    cutoffs_hz: Sequence[float] = CUTOFFS_HZ,
    progress: Callable[[str], None] = lambda _: None,
    smooth: bool = False,
    **parameters: Any,
) -> AttitudeBudget:
    """Return what temperature costs each filter and what compensation gives back.

    `smooth` adds the preset SMOOTHED: forward and backward over the recording. Recordings slower
    than 50 Hz are interpolated; `notes` of the result's recording say so.
    """
    fast = {name: upsample(r, LOWEST_RATE_HZ) for name, r in variants(raw, compensated).items()}
    measured = fast['raw']
    truth, costs, groups, efforts = measured.reference_orientation, [], {}, []
    for name in filters:
        for preset in (*presets, *([SMOOTHED] if smooth else [])):
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
            if preset != SMOOTHED:
                efforts.append(_effort(name, preset, measured, options))
    sweep = list(_sweep(fast, cutoffs_hz, progress, parameters))
    against = 'compensated run' if truth is None else TRUE_ATTITUDE
    return AttitudeBudget(
        recording=measured,
        against=against,
        costs=costs,
        sweep=sweep,
        efforts=efforts,
        groups=groups,
    )


def _estimate(name: str, recording: ImuRecording, options: dict[str, Any]) -> FloatArray:
    """Return the attitude sensor → ENU."""
    if options['preset'] == SMOOTHED:
        q = run_smoother(name, recording, **options | {'preset': 'robust'}).orientation
    else:
        q = run_filter(name, recording, **options).orientation
    frame = options.get('world_frame', 'enu')
    return q if frame == 'enu' else enu_from(frame, q)


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
        costs.append(
            Cost(
                filter=name,
                preset=preset,
                data=data,
                rms=rms,
                gain=gain,
                moved=_degrees(moved[data].rms()),
                cutoff_hz=cutoff_hz,
            )
        )
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


def budget_content(
    result: AttitudeBudget, recording: ImuRecording, drift: TenMinuteDrift | None = None
) -> dict[str, Any]:
    """Return the budget as plain values, angles in degrees.

    Without a true attitude there are no errors: `rms` and `gain` are null.
    """
    true = result.against == TRUE_ATTITUDE
    return {
        'bag': recording.source,
        'device': recording.device,
        'samples': len(result.recording),
        'against': result.against if true else 'no true attitude',
        'notes': list(result.recording.notes),
        'unplaced': dict(result.recording.unplaced),
        'costs': [_claimed(cost, true=true) for cost in result.costs],
        'cutoff_sweep': [_claimed(cost, true=true) for cost in result.sweep],
        'worse': worse_angles(result) if true else [],
        'ten_minutes': asdict(drift) if drift else None,
        'effort': [asdict(effort) for effort in result.efforts],
        'remarks': remarks_of(result),
        'groups': {
            name: [_group(group) for group in groups] for name, groups in result.groups.items()
        }
        if true
        else {},
    }


def _claimed(cost: Cost, *, true: bool) -> dict[str, Any]:
    return asdict(cost) if true else {**asdict(cost), 'rms': None, 'gain': None}


def worse_angles(result: AttitudeBudget) -> list[str]:
    """Return a sentence for every angle that compensating all sensors makes worse."""
    found = []
    for cost in (c for c in result.costs if c.data == 'compensated'):
        alone = {
            c.data.split()[0]: c.gain
            for c in result.costs
            if (c.filter, c.preset) == (cost.filter, cost.preset) and ' ' in c.data
        }
        for kind in ('heading', 'inclination'):
            if cost.gain[kind] >= -LEAST_WORSE_DEG:
                continue
            before = cost.rms[kind] + cost.gain[kind]
            parts = ', '.join(f'{s} alone {-g[kind]:+.3f}°' for s, g in alone.items())
            found.append(
                f'{_label(cost.filter)} {cost.preset}: {kind} gets worse, {before:.3f} → '
                f'{cost.rms[kind]:.3f}°: a thermal model leaves the constant offset of a sensor, '
                f'which its temperature error had cancelled in part ({parts})'
            )
    return found


@dataclass(frozen=True)
class TenMinuteDrift:
    """Angle by which the gyroscope's temperature error turns an attitude in ten minutes."""

    raw_deg: float
    """Rms over the recording; the modelled error integrated at this robot's own rates."""
    compensated_deg: float
    """The same of the model's own uncertainty, one standard deviation."""


def ten_minute_drift(
    raw: ImuRecording, compensated: ImuRecording, model: ThermalModel
) -> TenMinuteDrift | None:
    """Return what the gyroscope's temperature error costs without any correction by a filter."""
    sensor = model.sensors.get('gyroscope')
    removed = raw.angular_velocity - compensated.angular_velocity
    known = np.isfinite(removed).all(axis=1) & np.isfinite(raw.temperature)
    if sensor is None or known.sum() < 2:
        return None
    time = raw.time[known]
    part = (time // TEN_MINUTES_S).astype(int)
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    rows = np.diff(np.append(starts, len(part)))[:, np.newaxis]
    means = np.add.reduceat(removed[known], starts, axis=0) / rows
    some = raw.rows(np.flatnonzero(known)[:: max(int(known.sum()) // 500, 1)])
    conditions = field_conditions(some, model.reference_temperature).of('gyroscope')
    covariance = sensor_error(plan_of(sensor), conditions).covariance
    doubt = np.sqrt(np.mean(np.trace(covariance, axis1=1, axis2=2)))
    before = np.sqrt(np.mean(np.sum(means**2, axis=1)))
    turned = np.degrees([before, doubt]) * TEN_MINUTES_S
    return TenMinuteDrift(float(turned[0]), float(turned[1]))


def _group(group: ErrorGroup) -> dict[str, Any]:
    rms = {kind: float(np.degrees(value)) for kind, value in group.rms.items()}
    return {'label': group.label, 'rows': group.rows, 'rms': rms}


def remarks_of(result: AttitudeBudget) -> list[dict[str, Any]]:
    """Return the paper's remarks about the filters, each with our number."""
    moved = {
        (cost.filter, cost.data): cost.moved['total']
        for cost in result.costs
        if cost.preset == 'paper'
    }
    effort = {effort.filter: effort for effort in result.efforts if effort.preset == 'paper'}
    rows: list[dict[str, Any]] = []
    if {('ahrs', 'raw'), ('complementary', 'raw')} <= moved.keys():
        ours = {name: moved[name, 'compensated'] for name in ('ahrs', 'complementary')}
        rows.append(_remark('AHRS suffers more from temperature', ours, 'deg', 'ahrs'))
    single = {
        data.split()[0]: angle
        for (name, data), angle in moved.items()
        if name == 'ahrs' and ' ' in data
    }
    if single:
        rows.append(_remark('because of the magnetometer', single, 'deg', 'magnetometer'))
    if {'ahrs', 'complementary'} <= effort.keys():
        for unit, figure in (('ns', 'nanoseconds_per_sample'), ('B', 'state_bytes')):
            ours = {name: getattr(effort[name], figure) for name in ('ahrs', 'complementary')}
            rows.append(_remark('AHRS costs more', ours, unit, 'ahrs'))
    return rows


def _remark(text: str, ours: dict[str, float], unit: str, largest: str) -> dict[str, Any]:
    """Return a remark that holds where our number of `largest` exceeds all others."""
    holds = all(ours[largest] > value for name, value in ours.items() if name != largest)
    return {'remark': text, 'ours': ours, 'unit': unit, 'holds': holds}


def budget_text(content: Mapping[str, Any]) -> str:
    """Return the budget (the dictionary that --json writes) as the terminal shows it."""
    name, true = content['bag'] or content['device'], content['against'] == TRUE_ATTITUDE
    told = f'rms error [°] against the {content["against"]}' if true else NO_TRUTH
    lines = [f'{name}: {told}', *(f'  note: {note}' for note in content['notes'])]
    if content['ten_minutes']:
        drift = content['ten_minutes']
        lines.append(
            f"  Worth it? In ten minutes without correction the gyroscope's temperature error "
            f'turns the attitude by {drift["raw_deg"]:.3g}°; what the model does not know of it '
            f'by {drift["compensated_deg"]:.2g}°.'
        )
    kinds = ('total', 'heading', 'inclin.', 'gained') if true else ()
    lines += ['', f'{"":46}' + ''.join(f'{kind:>9}' for kind in (*kinds, 'moved'))]
    for cost in content['costs']:
        lines.append(_row(f'{_label(cost["filter"])} {cost["preset"]}, {cost["data"]}', cost))
    lines += [f'  {sentence}' for sentence in content['worse']]
    lines += ['', 'complementary over its cut-off:']
    lines += [_row(f'{c["cutoff_hz"]:g} Hz, {c["data"]}', c) for c in content['cutoff_sweep']]
    lines += ['', f'{"":46}{"ns/sample":>11}{"state [B]":>11}']
    for effort in content['effort']:
        label = f'{_label(effort["filter"])} {effort["preset"]}'
        nanoseconds, size = effort['nanoseconds_per_sample'], effort['state_bytes']
        lines.append(f'{label:46}{nanoseconds:11.0f}{size:11d}')
    lines += ['', "the paper's remarks:"] if content['remarks'] else []
    for row in content['remarks']:
        ours = ', '.join(f'{_label(k)} {v:.3g} {row["unit"]}' for k, v in row['ours'].items())
        lines.append(f'  {row["remark"]}: {"yes" if row["holds"] else "no"} ({ours})')
    return '\n'.join(lines)


def _label(name: str) -> str:
    return FILTER_LABELS.get(name, name)


def _row(label: str, cost: Mapping[str, Any]) -> str:
    kinds = ''
    if cost['rms']:
        kinds = ''.join(f'{cost["rms"][kind]:9.3f}' for kind in ERROR_KINDS)
        kinds += f'{cost["gain"]["total"]:9.3f}'
    return f'{label:46}{kinds}{cost["moved"]["total"]:9.3f}'
