# SPDX-License-Identifier: Apache-2.0
"""What an error of the reference moves a coefficient by: as much as a new fit of wrong data."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from imu_workbench.report.certificate.budget import SOURCES
from imu_workbench.report.certificate.quantities import Quantity, quantities
from imu_workbench.report.laboratory import Laboratory
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ThermalModel

from imu_recording import ImuRecording

LINE, SCALE = (EFFECTS[name]() for name in ('bias_temperature', 'scale_factor_temperature'))
MISALIGNMENT, ACROSS = (
    EFFECTS[name]() for name in ('misalignment_temperature', 'g_sensitivity_temperature')
)
TRUE_SCALE = 4e-4
"""Temperature coefficient of every scale factor [1/K]."""
TESLA = {'field': {'value': 45.0, 'expanded_uncertainty': 0.9, 'unit': 'µT'}}
TILT = {'mounting': {'tilt_half_width': 1.0, 'unit': '°'}}


@pytest.fixture(scope='module')
def recordings(run: Callable[..., ImuRecording]) -> list[ImuRecording]:
    """Three axes up, of which the first points down once more; scale factors change."""
    found = [run(up=up, seed=i, cycles=3) for i, up in enumerate('xyzx')]
    turned = found[3].magnetic_field - np.array([40e-6, 0.0, 0.0])
    found[3] = replace(found[3], magnetic_field=turned, run='again')
    return [with_scale(recording) for recording in found]


def with_scale(recording: ImuRecording, tilt: Any = (0.0, 0.0, 0.0)) -> ImuRecording:
    """Return the recording with scale factors that change, of a force turned by `tilt` [rad]."""
    up = 9.80665 * np.eye(3)['xyz'.index(recording.up_axis[1])]
    up *= 1.0 if recording.up_axis[0] == '+' else -1.0
    force = up + np.cross(tilt, up)
    warmth = (recording.temperature - 20.0)[:, None]
    return replace(
        recording,
        linear_acceleration=recording.linear_acceleration + TRUE_SCALE * warmth * force,
        magnetic_field=recording.magnetic_field
        + TRUE_SCALE * warmth * recording.magnetic_field.mean(axis=0),
    )


def fitted(
    recordings: Sequence[ImuRecording], sensor: str, *effects: Any
) -> tuple[ThermalModel, list[PreparedRun]]:
    """Return the model of one sensor and its runs."""
    runs = prepare(recordings, period=20.0)
    return fit_prepared({sensor: list(effects)}, runs), runs


def certified(
    recordings: Sequence[ImuRecording], sensor: str, *effects: Any, **stated: Any
) -> dict[str, Quantity]:
    """Return the quantities of one sensor by coefficient and axis."""
    model, runs = fitted(recordings, sensor, *effects)
    found = quantities(model, runs, [r.up_axis for r in recordings], Laboratory(stated))
    return {f'{q.coefficient} {q.axis}': q for q in found if q.sensor == sensor}


def contribution(quantity: Quantity, source: str) -> float:
    """Return what a source contributes."""
    return next(row.contribution for row in quantity.budget.rows if row.input.source == source)


def test_gravity_acts_on_what_is_proportional_to_it(recordings: list[ImuRecording]) -> None:
    stated = {'gravity': {'value': 9.81, 'expanded_uncertainty': 0.02, 'unit': 'm/s²'}}
    found = certified(recordings, 'accelerometer', LINE, SCALE, **stated, **TILT)
    off = math.hypot(0.01, 9.81 - 9.80665) / 9.80665
    for axis in 'xyz':
        scale = found[f'scale_factor_temperature, s_{axis} all']
        assert scale.budget.value == pytest.approx(TRUE_SCALE, rel=0.1)
        expected = abs(scale.budget.value) * off
        assert contribution(scale, 'reference: gravity') == pytest.approx(expected)
        slope = found[f'slope {axis}'].budget
        assert not any('gravity' in row.input.source for row in slope.rows)
    nobody = certified(recordings, 'accelerometer', LINE, SCALE)['slope x'].budget.others
    assert nobody['reference: tilt'] == 'not stated'
    across = certified(recordings, 'gyroscope', LINE, ACROSS, **TILT)
    gained = next(q for name, q in across.items() if name.startswith('g_sensitivity'))
    assert any(row.input.source == 'reference: gravity' for row in gained.budget.rows)


@pytest.mark.long
def test_the_field_acts_on_scale_factors_of_the_magnetometer(
    recordings: list[ImuRecording],
) -> None:
    _, runs = fitted(recordings, 'magnetometer', LINE, SCALE)
    iron = runs[0].conditions.hard_iron
    used = np.mean(
        [
            np.linalg.norm(r.conditions.magnetic_field[0] - (0.0 if iron is None else iron))
            for r in runs
        ]
    )
    found = certified(recordings, 'magnetometer', LINE, SCALE, **TESLA)
    scale = found['scale_factor_temperature, s_y all']
    off = math.hypot(0.45e-6, 45e-6 - used) / used
    expected = abs(scale.budget.value) * off
    assert contribution(scale, 'reference: field') == pytest.approx(expected)
    silent = certified(recordings, 'magnetometer', LINE, SCALE)
    assert silent['scale_factor_temperature, s_y all'].budget.others['reference: field'] == (
        'not stated'
    )
    assert 'reference: field' not in silent['slope y'].budget.others


@pytest.mark.long
def test_a_field_that_varies_moves_coefficients_as_a_new_fit(
    recordings: list[ImuRecording],
) -> None:
    """Each run and axis in turn: the sum of the changes is the half-width of the input."""
    half = 60e-9
    stated = {'field': {'variation_half_width': half * 1e9, 'unit': 'nT'}}
    found = certified(recordings, 'magnetometer', LINE, SCALE, **stated)
    before, runs = fitted(recordings, 'magnetometer', LINE, SCALE)
    low, high = before.sensors['magnetometer'].temperature_range
    moved = []
    for k in range(len(recordings)):
        wrong = list(runs)
        course = math.sqrt(2.0) * half * (runs[k].temperature - 20.0) / (high - low)
        field = runs[k].measured['magnetometer'] + course[:, None] * np.eye(3)[1]
        wrong[k] = replace(runs[k], measured={**runs[k].measured, 'magnetometer': field})
        noise = {'magnetometer': before.sensors['magnetometer'].noise}
        after = fit_prepared({'magnetometer': [LINE, SCALE]}, wrong, noise=noise)
        line, scale = (
            b - a
            for a, b in zip(*(m.sensors['magnetometer'].coefficients for m in (before, after)),
                            strict=True)
        )  # fmt: skip
        moved.append([abs(line[0, 1]), abs(scale[1])])
    slope, scale = np.sum(moved, axis=0) / math.sqrt(3.0)
    source = 'reference: field variation'
    assert contribution(found['slope y'], source) == pytest.approx(slope, rel=0.05)
    held = found['scale_factor_temperature, s_y all']
    assert contribution(held, source) == pytest.approx(scale, rel=0.05)
    line = certified(recordings, 'magnetometer', LINE, **stated)['slope y']
    simple = half * math.sqrt(2.0 / 3.0) / (high - low)
    assert contribution(line, source) == pytest.approx(simple, rel=0.03)
    unstated = certified(recordings, 'magnetometer', LINE)['slope y'].budget
    assert unstated.others[source] == 'not stated'


@pytest.mark.long
def test_a_tilt_moves_misalignments_as_a_new_fit(run: Callable[..., ImuRecording]) -> None:
    straight = [run(up=up, seed=i, cycles=3) for i, up in enumerate('xyz')]
    flipped = [
        replace(r, up_axis=f'-{r.up_axis[1]}', run=f'{r.run} down',
                linear_acceleration=r.linear_acceleration - 2.0 * 9.81 * np.eye(3)[k])
        for k, r in enumerate(straight)
    ]  # fmt: skip
    level = [np.zeros(3)] * 6

    def turned(tilts: Sequence[Any]) -> list[ImuRecording]:
        return [with_scale(r, tilt) for r, tilt in zip([*straight, *flipped], tilts, strict=True)]

    effects = (LINE, SCALE, MISALIGNMENT)
    found = certified(turned(level), 'accelerometer', *effects, **TILT)
    before, _ = fitted(turned(level), 'accelerometer', *effects)
    squares = 0.0
    for k in range(6):
        for axis in range(3):
            tilts = [1e-2 * np.eye(3)[axis] * (j == k) for j in range(6)]
            after, _ = fitted(turned(tilts), 'accelerometer', *effects)
            change = [m.sensors['accelerometer'].coefficients[2][0] for m in (before, after)]
            squares += float((change[1] - change[0]) / 1e-2) ** 2
    expected = math.sqrt(squares / 3.0) * math.sin(math.radians(1.0))
    own = found['misalignment_temperature, k_xy all']
    assert contribution(own, 'reference: tilt') == pytest.approx(expected, rel=0.15)


def test_every_budget_accounts_for_every_source(recordings: list[ImuRecording]) -> None:
    found = certified(recordings, 'magnetometer', LINE, SCALE)
    assert found
    for quantity in found.values():
        named = [*(r.input.source for r in quantity.budget.rows), *quantity.budget.others]
        assert all(any(n.startswith(source) for n in named) for source in SOURCES)
