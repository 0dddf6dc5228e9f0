# SPDX-License-Identifier: Apache-2.0
"""What a fit refuses or leaves out, and which sensors it solves together."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from thermal_comp.fitting.inputs import (
    LEAST_SPAN_K,
    check_temperature,
    effects_by_sensor,
    sensor_groups,
    usable_sensors,
)
from thermal_comp.model.values import ModelError

from ..campaign import run

LINE = (EFFECTS['bias_temperature'](),)


def test_mixed_devices_are_refused_by_name_unless_pooled() -> None:
    mixed = [run(device='dut1'), run(device='dut2', seed=1)]
    with pytest.raises(ModelError, match='dut1, dut2; fit each by itself'):
        fit(LINE, mixed)
    assert fit(LINE, mixed, pooled=True).device == 'dut1+dut2'


def test_bad_input_is_refused_in_one_line_or_left_out_and_said() -> None:
    good = run(cycles=1)
    with pytest.raises(ModelError, match='no recordings'):
        fit(LINE, [])
    with pytest.raises(ModelError, match='hold the same data'):
        fit(LINE, [good, good])
    still = replace(good, temperature=np.full(len(good), 21.5))
    with pytest.raises(ModelError, match=r'stays within 21\.50 … 21\.50 °C'):
        fit(LINE, [still])
    with pytest.raises(ModelError, match='supply_sensitivity needs supply_voltage'):
        fit([*LINE, EFFECTS['supply_sensitivity']()], [good])
    with pytest.raises(ModelError, match='listed twice'):
        fit([*LINE, *LINE], [good])
    stuck = replace(good, magnetic_field=np.full((len(good), 3), 2e-5))
    model = fit(LINE, [stuck])
    assert sorted(model.sensors) == ['accelerometer', 'gyroscope']
    assert any('magnetometer left out' in note for note in model.provenance.notes)
    missing = replace(good, magnetic_field=np.full((len(good), 3), np.nan))
    assert 'magnetometer' not in fit(LINE, [missing]).sensors


def test_the_span_of_all_runs_together_counts() -> None:
    good = run(cycles=1)
    span = LEAST_SPAN_K / 4.0
    cold, warm = (
        replace(good, temperature=middle + span * np.sin(np.arange(len(good)) / 50.0))
        for middle in (20.0, 21.5)
    )
    with pytest.raises(ModelError, match='needs a span'):
        check_temperature(prepare([cold]))
    low, high = check_temperature(prepare([cold, warm]))
    assert high - low == pytest.approx(2.5, abs=0.1)


def test_an_axis_that_never_changes_is_named_with_its_run() -> None:
    good = run(cycles=1)
    field = good.magnetic_field.copy()
    field[:, 1] = 2e-5
    sensors, notes = usable_sensors(prepare([good, replace(good, magnetic_field=field)]))
    assert sensors == ['accelerometer', 'gyroscope']
    assert notes == ['magnetometer left out: axis y of run +z 0 (2) never changes']


def test_only_sensors_that_share_coefficients_are_solved_together() -> None:
    runs = prepare([run(cycles=1)])
    sensors = ('accelerometer', 'gyroscope', 'magnetometer')
    alone = effects_by_sensor(LINE, sensors, runs)
    assert sensor_groups(alone) == [(sensor,) for sensor in sensors]
    tilted = effects_by_sensor((*LINE, EFFECTS['fixture_tilt']()), sensors, runs)
    assert [len(effects) for effects in tilted.values()] == [2, 1, 2]
    assert sensor_groups(tilted) == [('gyroscope',), ('accelerometer', 'magnetometer')]
    with pytest.raises(ModelError, match='does not act on the gyroscope'):
        effects_by_sensor({'gyroscope': (EFFECTS['fixture_tilt'](),)}, sensors, runs)
