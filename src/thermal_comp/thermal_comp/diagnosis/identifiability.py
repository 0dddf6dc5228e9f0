# SPDX-License-Identifier: Apache-2.0
"""What the runs cannot tell apart, whatever the sensors do: too few poses, no thermal cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.decision import Outcome
from thermal_comp.diagnosis.result import Undecided
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import ColumnBank, ColumnSource
from thermal_comp.model.values import NoiseModel

ALIKE = 0.9
"""Share of an effect's χ² that a rival takes over, from which they cannot be told apart."""
SAME_INPUT = 0.05
"""A sensor's true input that varies by less than this share over the runs is one pose."""
ONE_WAY = 0.95
"""Share of the temperature's travel in one direction that makes a sweep."""
PAIRS = (
    ('bias_temperature_curvature', 'thermal_lag'),
    ('bias_temperature_curvature', 'thermal_hysteresis'),
    ('bias_temperature_curvature', 'warm_up'),
    ('thermal_lag', 'thermal_hysteresis'),
    ('thermal_lag', 'temperature_rate'),
)
"""Effects that only a temperature that returns, or comes at several rates, tells apart."""
SCALE_OF: dict[Sensor, str] = {
    'accelerometer': 'scale_factor_temperature',
    'gyroscope': 'g_sensitivity_temperature',
    'magnetometer': 'scale_factor_temperature',
}
"""Effects that need another pose to be told from a bias."""


def undecidable(
    runs: Sequence[PreparedRun],
    base: Mapping[Sensor, Sequence[Effect]],
    outcomes: Mapping[Sensor, Outcome],
    noise: Mapping[Sensor, NoiseModel],
) -> tuple[Undecided, ...]:
    """Return what cannot be decided from these runs: nothing for cycles in several poses."""
    found = list(_poses(runs, tuple(base)))
    if not all(run.has_cycles for run in runs):
        found += _shapes(runs, base, noise)
        found += [
            Undecided(
                (r.name, 'bias_temperature'),
                (sensor,),
                1.0,
                f'{r.name} follows what was seen (evidence {r.evidence:.0f}), but foresees blocks '
                f'left out worse: {r.error_with:.3g} against {r.error_without:.3g}',
                'it is not recommended: record cycles',
            )
            for sensor, outcome in outcomes.items()
            for r in outcome.rejected
        ]
    return tuple(found)


def _poses(runs: Sequence[PreparedRun], sensors: Sequence[Sensor]) -> list[Undecided]:
    """Bias and scale factor need the input of a sensor's axes to differ between runs."""
    single: dict[tuple[str, str], list[Sensor]] = {}
    for sensor in sensors:
        inputs = np.array([_true_input(run, sensor) for run in runs])
        size = float(np.abs(inputs).max())
        if np.ptp(inputs, axis=0).max() <= SAME_INPUT * size:
            single.setdefault(('bias_temperature', SCALE_OF[sensor]), []).append(sensor)
    return [
        Undecided(
            pair,
            tuple(found),
            1.0,
            'one pose: gravity and field never change, so that a bias and a scale factor over '
            'temperature leave the same trace',
            'record other axes up, one of them both ways',
        )
        for pair, found in single.items()
    ]


def _true_input(run: PreparedRun, sensor: Sensor) -> FloatArray:
    """(3,) mean of what makes the scale factor visible; gravity for the gyroscope."""
    conditions = run.conditions
    field = conditions.magnetic_field if sensor == 'magnetometer' else conditions.specific_force
    return np.asarray(np.nanmean(field, axis=0))


def _shapes(
    runs: Sequence[PreparedRun],
    base: Mapping[Sensor, Sequence[Effect]],
    noise: Mapping[Sensor, NoiseModel],
) -> list[Undecided]:
    """Effects of PAIRS that leave nearly the same trace in the runs, with the noise of one sensor.

    The columns of an effect depend on the sensor only through its noise: the first one serves.
    """
    sensor = next((s for s in SENSORS if s in base), None)
    if sensor is None:
        return []
    bank = ColumnBank(ColumnSource(runs), sensor, noise[sensor], base[sensor])
    reason = _history(runs)
    found = []
    for one, other in PAIRS:
        share = max(_similarity(bank, one, other), _similarity(bank, other, one))
        if share >= ALIKE:
            found.append(
                Undecided(
                    (one, other),
                    tuple(base),
                    share,
                    reason,
                    'let the temperature return at the same rate, and hold it',
                )
            )
    return found


def _history(runs: Sequence[PreparedRun]) -> str:
    """Return what the temperature did, in words."""
    steps = np.concatenate([np.diff(run.temperature) for run in runs])
    travel = float(np.abs(steps).sum())
    ways = (float(steps[steps > 0.0].sum()) / travel if travel else 0.0, 'warming'), (
        float(-steps[steps < 0.0].sum()) / travel if travel else 0.0, 'cooling')  # fmt: skip
    share, way = max(ways)
    if share >= ONE_WAY:
        return f'one {way} sweep passes each temperature once'
    return 'no thermal cycle repeats'


def _similarity(bank: ColumnBank, truth: str, rival: str) -> float:
    """Return the share of the trace of an effect that a rival would explain at its best shape."""
    wanted = bank.term(EFFECTS[truth]()).columns
    best = 0.0
    for form in _forms(rival):
        known = list(bank.term(form).columns)
        before, after = 0.0, 0.0
        normal, _ = bank.reduced([], wanted)
        reduced, _ = bank.reduced(known, wanted)
        before += float(np.trace(normal, axis1=1, axis2=2).sum())
        after += float(np.trace(reduced, axis1=1, axis2=2).sum())
        best = max(best, 1.0 - after / before if before > 0.0 else 0.0)
    return best


def _forms(name: str) -> list[Effect]:
    """Return an effect with time constants and widths from short to long."""
    effect: type = EFFECTS[name]
    if name == 'thermal_hysteresis':
        return [effect((w,)) for w in (1.0, 2.0, 4.0, 8.0)]
    if name in {'thermal_lag', 'warm_up'}:
        return [effect(t) for t in (60.0, 120.0, 300.0, 900.0, 1800.0)]
    return [effect()]
