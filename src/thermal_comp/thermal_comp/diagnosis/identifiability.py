# SPDX-License-Identifier: Apache-2.0
"""What the runs cannot tell apart, whatever the sensors do: too few poses, no thermal cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.evidence.candidates import usable
from thermal_comp.diagnosis.result import Undecided
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import NoiseModel

SIMILAR_SHARE = 0.9
"""Share of an effect's χ² that a rival takes over, from which they cannot be told apart."""
POSE_SHARE = 0.05
"""A sensor's true input that varies by less than this share over the runs is one pose."""
SWEEP_SHARE = 0.95
"""Share of the temperature's travel in one direction that makes a sweep."""


def undecidable(
    runs: Sequence[PreparedRun],
    base: Mapping[Sensor, Sequence[Effect]],
    noise: Mapping[Sensor, NoiseModel],
    catalogue: Mapping[str, type[Effect]],
) -> tuple[Undecided, ...]:
    """Return what cannot be decided from these runs: nothing for cycles in several poses."""
    found = list(_poses(runs, tuple(base), catalogue))
    if not all(run.has_cycles for run in runs):
        found += _shapes(runs, base, noise, catalogue)
    return tuple(found)


def _poses(
    runs: Sequence[PreparedRun], sensors: Sequence[Sensor], catalogue: Mapping[str, type[Effect]]
) -> list[Undecided]:
    """Bias and scale factor need the input of a sensor's axes to differ between runs."""
    single: dict[tuple[str, str], list[Sensor]] = {}
    for sensor in sensors:
        inputs = np.array([_true_input(run, sensor) for run in runs])
        size = float(np.abs(inputs).max())
        if np.ptp(inputs, axis=0).max() <= POSE_SHARE * size:
            for effect in catalogue.values():
                if sensor in effect.separated_by_poses:
                    single.setdefault((BiasTemperature.name, effect.name), []).append(sensor)
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
    catalogue: Mapping[str, type[Effect]],
) -> list[Undecided]:
    """Effects that only cycles separate, if they leave nearly the same trace in these runs.

    Their columns depend on the sensor only through its noise: that of the first one serves.
    """
    sensor = next((s for s in SENSORS if s in base), None)
    if sensor is None:
        return []
    design = CandidateDesign(ColumnSource(runs), sensor, noise[sensor], base[sensor])
    reason = _history(runs)
    found = []
    offered = {n: e for n, e in catalogue.items() if usable(e, sensor, runs)}
    pairs = [
        (e, offered[n]) for e in offered.values() for n in e.separated_by_cycles if n in offered
    ]
    for one, other in pairs:
        share = max(_similarity(design, one, other), _similarity(design, other, one))
        if share >= SIMILAR_SHARE:
            found.append(
                Undecided(
                    (one.name, other.name),
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
    if share >= SWEEP_SHARE:
        return f'one {way} sweep passes each temperature once'
    return 'no thermal cycle repeats'


def _similarity(design: CandidateDesign, truth: type[Effect], rival: type[Effect]) -> float:
    """Return the share of the trace of an effect that a rival would explain at its best shape."""
    wanted = design.term(truth()).columns
    best = 0.0
    for form in rival.sample_forms():
        known = list(design.term(form).columns)
        before, after = 0.0, 0.0
        normal = design.reduced([], wanted)
        reduced = design.reduced(known, wanted)
        before += float(np.trace(normal, axis1=1, axis2=2).sum())
        after += float(np.trace(reduced, axis1=1, axis2=2).sum())
        best = max(best, 1.0 - after / before if before > 0.0 else 0.0)
    return best
