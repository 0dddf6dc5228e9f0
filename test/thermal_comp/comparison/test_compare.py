# SPDX-License-Identifier: Apache-2.0
"""Errors on parts the fit has not seen, against what noise alone would leave."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_workbench.answer import plain
from thermal_comp.comparison.compare import compare
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from thermal_comp.model.values import ModelError

from imu_recording import read_bag

from ..campaign import chamber, lagging, run

LINE = (EFFECTS['bias_temperature'](),)


def lag_error(size: float) -> dict[str, np.ndarray]:
    _, die, _, _ = chamber()
    return {'angular_velocity': size * (lagging(die, 300.0, 5.0) - die)[:, None] * np.ones(3)}


def test_a_complete_model_reaches_the_noise_floor(bags: Path) -> None:
    recordings = [read_bag(bags / f'dut1_{axis}') for axis in 'xyz']
    comparison = compare(fit(LINE, recordings), recordings)
    for part in comparison.sensors.values():
        assert (part.measured_rms > 2.0 * part.residual_rms).all()
        ratio = np.sqrt(np.mean((part.held_out_rms / part.noise_floor) ** 2))
        assert 0.85 < ratio < 1.15
        assert part.where[0].ratio < 1.5
    accelerometer = comparison.sensors['accelerometer']
    assert all(not test.gaussian for test in accelerometer.gaussianity_before)
    assert all(test.gaussian for test in accelerometer.gaussianity_after)
    assert all(accelerometer.modes_before.bimodal)
    assert not any(accelerometer.modes_after.bimodal)
    assert (accelerometer.r_squared > 0.999).all()


@pytest.mark.parametrize(
    'channel',
    [
        'supply_voltage',
        *(pytest.param(c, marks=pytest.mark.long) for c in ('humidity', 'chamber_temperature')),
    ],
)
def test_what_a_channel_does_is_no_noise_before_its_effect_is_known(channel: str) -> None:
    time = chamber()[0]
    course = np.sin(2.0 * np.pi * time / 5000.0) + (time % 9000.0 > 4000.0)
    error = {'angular_velocity': 6e-4 * course[:, None] * np.array([1.0, -0.5, 0.8])}
    plain_run = run(error=error)
    comparison = compare(
        fit(LINE, [plain_run]), [replace(plain_run, **{channel: 5.0 + 0.1 * course})]
    )
    part = comparison.sensors['gyroscope']
    assert (part.held_out_rms > 3.0 * part.noise_floor).all()


def test_a_missing_effect_shows_where_it_acts_and_falls_when_added() -> None:
    recordings = [run(up, seed=k, error=lag_error(1e-4)) for k, up in enumerate(('+x', '+z'))]
    line = compare(fit(LINE, recordings), recordings).sensors['gyroscope']
    assert (line.held_out_rms > 3.0 * line.noise_floor).all()
    assert line.worst_phase in ('ramp_up', 'ramp_down')
    complete = fit({'gyroscope': (*LINE, EFFECTS['thermal_lag']())}, recordings)
    full = compare(complete, recordings).sensors['gyroscope']
    np.testing.assert_allclose(full.noise_floor, line.noise_floor, rtol=0.02)
    assert np.sqrt(np.mean((full.held_out_rms / full.noise_floor) ** 2)) < 1.15


def test_the_held_out_error_is_not_smaller_than_the_residual() -> None:
    recordings = [run(seed=4)]
    effects = (*LINE, EFFECTS['bias_temperature_curvature'](), EFFECTS['thermal_lag']())
    comparison = compare(fit(effects, recordings), recordings)
    for part in comparison.sensors.values():
        assert (part.held_out_rms > 0.98 * part.residual_rms).all()


def test_without_cycles_contiguous_blocks_are_held_out_and_it_is_said() -> None:
    recording = replace(run(cycles=1), cycle=None, phase=None)
    comparison = compare(fit(LINE, [recording]), [recording])
    assert 'contiguous block' in comparison.held_out
    assert any('12 contiguous blocks' in note for note in comparison.notes)


def test_bias_of_each_cycle_is_taken_like_a_level_and_said() -> None:
    _, _, _, cycle = chamber()
    jumps = np.array([0.0, 0.0, 2e-3, -1e-3, 3e-3])[np.maximum.accumulate(cycle)][:, None]
    recordings = [run(error={'angular_velocity': jumps * np.ones(3)})]
    line = compare(fit(LINE, recordings), recordings).sensors['gyroscope']
    model = fit({'gyroscope': (*LINE, EFFECTS['turn_on_bias']())}, recordings)
    comparison = compare(model, recordings)
    part = comparison.sensors['gyroscope']
    assert (line.held_out_rms > 5.0 * line.noise_floor).all()
    assert np.sqrt(np.mean((part.held_out_rms / part.noise_floor) ** 2)) < 1.25
    assert any('turn_on_bias' in note for note in comparison.notes)


def test_a_mean_over_the_end_of_a_cycle_belongs_to_neither() -> None:
    cycle = chamber(period=20.0)[3]
    levels = 5e-3 * np.array([0.0, 0.0, 1.0, -1.0, 2.0])[cycle]
    ends = 1 + np.flatnonzero(np.diff(cycle))
    levels[ends] = 0.5 * (levels[ends - 1] + levels[ends])
    error = {'angular_velocity': levels[:, None] * np.array([1.0, -0.6, 0.3])}
    recordings = [run(period=20.0, seed=3, error=error)]
    effects = {'gyroscope': (*LINE, EFFECTS['turn_on_bias']())}
    found = compare(fit(effects, recordings), recordings).sensors['gyroscope']
    assert (found.held_out_rms < 1.15 * found.noise_floor).all()
    assert (found.residual_rms < 2e-4).all()


def test_a_model_is_compared_with_recordings_it_has_not_seen() -> None:
    comparison = compare(fit(LINE, [run(seed=1)]), [run(seed=2)])
    assert any('has not seen these recordings' in note for note in comparison.notes)
    for part in comparison.sensors.values():
        assert (part.residual_rms < 1.5 * part.noise_floor).all()
    drifted = compare(fit(LINE, [run(seed=1)]), [run(seed=2, slope_factor=1.1)])
    gyroscope = drifted.sensors['gyroscope']
    assert (gyroscope.residual_rms > 2.0 * gyroscope.held_out_rms).all()


def test_another_device_is_refused() -> None:
    with pytest.raises(ModelError, match='the model is of board, the data of other'):
        compare(fit(LINE, [run(cycles=2)]), [run(cycles=2, device='other')])


def test_content_is_plain_and_has_the_documented_fields() -> None:
    recordings = [run(cycles=2)]
    content = json.loads(json.dumps(plain(compare(fit(LINE, recordings), recordings).to_dict())))
    assert content['schema'] == 1
    assert content['device'] == 'board'
    gyroscope = content['sensors']['gyroscope']
    assert gyroscope['unit'] == 'rad/s'
    for key in ('measured_rms', 'residual_rms', 'held_out_rms', 'noise_floor'):
        assert len(gyroscope[key]) == 3
    assert gyroscope['where'][0]['ratio'] >= gyroscope['where'][-1]['ratio']
    assert {'chi_square', 'effective_n', 'p_value'} <= set(gyroscope['gaussianity']['before'][0])
