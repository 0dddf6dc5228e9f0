# SPDX-License-Identifier: Apache-2.0
"""The fit finds what is in the data, says how sure it is, and names what it cannot know."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_driver.simulation.devices import DEVICES
from imu_recording.recording import SENSOR_FIELDS
from imu_recording.tables.csv_import import import_csv
from thermal_comp.comparison.compare import compare
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit

from imu_recording import read_bag

from ..campaign import SLOPES, WHITE, chamber, lagging, run, slow_days

LINE = (EFFECTS['bias_temperature'](),)


def three_runs(**options: object) -> list:
    return [run(up, seed=k, **options) for k, up in enumerate(('+x', '+y', '+z'))]


def test_slopes_of_the_simulated_device_come_back(bags: Path) -> None:
    model = fit(LINE, [read_bag(bags / f'dut1_{axis}') for axis in 'xyz'])
    device = DEVICES['dut1']
    for sensor in SENSOR_FIELDS:
        # Per degree of the die's own thermometer, which has a gain error.
        true = getattr(device, sensor).slope / (1.0 + device.thermometer_gain)
        slope = model.sensors[sensor].coefficients[0][0]
        np.testing.assert_allclose(slope, true, rtol=0.01, atol=3e-3 * np.abs(true).max())


def test_stated_intervals_hold_under_coloured_noise() -> None:
    scores = []
    for seed in range(8):
        model = fit(LINE, [run(seed=100 + seed)])
        for sensor, name in SENSOR_FIELDS.items():
            fitted = model.sensors[sensor]
            std = np.sqrt(np.diag(fitted.covariance))
            scores += ((fitted.coefficients[0][0] - SLOPES[name]) / std).tolist()
    # 72 standard scores: their rms is 1 ± 0.17 where the intervals are honest.
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_the_noise_found_is_the_noise_put_in() -> None:
    model = fit(LINE, three_runs())
    for sensor, name in SENSOR_FIELDS.items():
        found = np.sqrt(model.sensors[sensor].noise.variance_of_means(20.0))
        put_in = WHITE[name] * np.sqrt(1 / 20.0 + 2 * 0.4**2)
        assert found == pytest.approx(put_in, rel=0.35)


def test_a_noisy_thermometer_dilutes_no_slope_of_a_slow_recording() -> None:
    recording = slow_days(lambda time, die: {})
    model = fit(LINE, [recording])
    fitted = model.sensors['accelerometer']
    found, std = fitted.coefficients[0][0], np.sqrt(np.diag(fitted.covariance))
    true = SLOPES['linear_acceleration']
    assert (np.abs(found - true) < 3.0 * std).all()
    assert (std < 0.05 * np.abs(true)).all()
    sensor = compare(model, [recording]).sensors['accelerometer']
    assert (sensor.held_out_rms < 1.1 * sensor.noise_floor).all()


def test_a_lag_is_found_with_its_time_constant() -> None:
    _, die, _, _ = chamber()
    loop = 4e-4 * (lagging(die, 150.0, 5.0) - die)[:, None] * np.array([1.0, -0.6, 0.3])
    recordings = three_runs(error={'angular_velocity': loop})
    model = fit({'gyroscope': (*LINE, EFFECTS['thermal_lag']())}, recordings)
    gyroscope = model.sensors['gyroscope']
    (std,) = gyroscope.shape_std['thermal_lag.time_constant']
    found = gyroscope.effects[1].time_constant
    assert abs(found - 150.0) < 3.0 * std
    assert std < 10.0
    np.testing.assert_allclose(
        gyroscope.coefficients[1][0], 4e-4 * np.array([1.0, -0.6, 0.3]), rtol=0.1
    )
    assert model.sensors['accelerometer'].effects == ()


def test_three_orientations_leave_one_mode_per_axis_and_a_fourth_tells_it() -> None:
    effects = [
        EFFECTS[name]()
        for name in ('bias_temperature', 'scale_factor_temperature', 'misalignment_temperature')
    ]
    three = fit({'accelerometer': effects}, three_runs())
    named = [note for note in three.provenance.notes if 'cannot be told apart' in note]
    assert len(named) == 3
    assert all('bias_temperature' in note for note in named)
    four = fit({'accelerometer': effects}, [*three_runs(), run('-x', seed=3)])
    assert not any('cannot be told apart' in note for note in four.provenance.notes)
    accelerometer = four.sensors['accelerometer']
    std = np.sqrt(np.diag(accelerometer.covariance))[:3]
    slopes = SLOPES['linear_acceleration']
    assert (np.abs(accelerometer.coefficients[0][0] - slopes) < 4.0 * std).all()


def test_what_is_not_excited_is_said_to_be() -> None:
    model = fit([*LINE, EFFECTS['scale_factor_temperature']()], [run()])
    assert any(
        'gyroscope: scale_factor_temperature is not excited' in note
        for note in model.provenance.notes
    )
    np.testing.assert_array_equal(model.sensors['gyroscope'].coefficients[1], 0.0)


def test_a_run_too_short_for_a_noise_spectrum_is_fitted_with_white_noise_and_said_so() -> None:
    model = fit(LINE, [run(cycles=1).rows(slice(400, 428))])
    gyroscope = model.sensors['gyroscope']
    slopes = gyroscope.coefficients[0][0]
    np.testing.assert_allclose(slopes, SLOPES['angular_velocity'], rtol=0.3)
    assert (gyroscope.noise.variance_of_means(20.0) > 0.0).all()
    assert any('too short to tell the colour' in note for note in model.provenance.notes)


def test_data_without_noise_give_the_exact_line() -> None:
    model = fit(LINE, [run(cycles=1, noise=0.0)])
    for sensor, name in SENSOR_FIELDS.items():
        slope = model.sensors[sensor].coefficients[0][0]
        np.testing.assert_allclose(slope, SLOPES[name], rtol=1e-9)


def test_a_shape_parameter_at_its_limit_is_said_to_be() -> None:
    time, *_ = chamber()
    slow = 1e-3 * (time / time[-1])[:, None] * np.ones(3)
    model = fit(
        {'gyroscope': (*LINE, EFFECTS['warm_up']())}, [run(error={'angular_velocity': slow})]
    )
    assert any('warm up: time constant ends at 7200' in note for note in model.provenance.notes)


def test_levels_belong_to_runs_and_do_not_disturb_the_slope() -> None:
    plain, shifted = three_runs(), three_runs()
    moved = shifted[1].angular_velocity + np.array([0.5, -0.2, 0.1])
    shifted[1] = replace(shifted[1], angular_velocity=moved)
    before, after = fit(LINE, plain), fit(LINE, shifted)
    np.testing.assert_allclose(
        after.sensors['gyroscope'].coefficients[0],
        before.sensors['gyroscope'].coefficients[0],
        rtol=1e-8,
    )
    name = shifted[1].run
    rise = after.sensors['gyroscope'].levels[name] - before.sensors['gyroscope'].levels[name]
    np.testing.assert_allclose(rise, [0.5, -0.2, 0.1], rtol=1e-8)


def test_single_samples_give_the_same_slopes_as_block_means() -> None:
    recordings = [run(period=2.0)]
    blocks, samples = fit(LINE, recordings), fit(LINE, recordings, period=0.0)
    for sensor in SENSOR_FIELDS:
        a, b = blocks.sensors[sensor], samples.sensors[sensor]
        std = np.sqrt(np.diag(b.covariance))
        assert (np.abs(a.coefficients[0][0] - b.coefficients[0][0]) < 3.0 * std).all()
        assert (std >= 0.99 * np.sqrt(np.diag(a.covariance))).all()


def test_a_prior_holds_coefficients_at_single_samples_as_at_block_means() -> None:
    """Its widths: x at a block's noise, y at nothing at all, z at a hundred times the noise."""
    noise = WHITE['angular_velocity'] / np.sqrt(20.0)
    widths = tuple((noise * np.tile([1.0, 0.0, 100.0], (4, 1))).ravel().tolist())
    effects = {'gyroscope': (*LINE, EFFECTS['empirical_term'](20.0, 30.0, widths))}
    recordings = [run(period=5.0, cycles=3)]
    models = [fit(effects, recordings, period=period) for period in (20.0, 0.0)]
    blocks, samples = (m.sensors['gyroscope'] for m in models)
    assert (np.abs(samples.coefficients[1][:, 1]) < 1e-12).all()
    std = np.sqrt(np.diag(samples.covariance)).reshape(-1, 3)[1:]
    assert (std[:, 0] < 4.0 * noise).all()
    assert (std[:, 1] < 1e-12).all()
    size = [np.linalg.norm(part.coefficients[1], axis=0) for part in (blocks, samples)]
    share = (size[1] / size[0])[[0, 2]]
    assert ((share > 0.3) & (share < 1.5)).all()


@pytest.mark.shared_data
def test_a_board_warming_up_without_cycles_is_fitted_and_compared(shared: Path) -> None:
    csv = shared / 'data' / 'freeimu_freezer' / 'Tempdata01-02-14.csv'
    mapping = Path(__file__).resolve().parents[3] / 'examples' / 'freeimu_mapping.yaml'
    recording = import_csv(csv, mapping)
    model = fit(LINE, [recording], period=20.0)
    comparison = compare(model, [recording], period=20.0)
    assert any('10 contiguous blocks' in note for note in comparison.notes)
    accelerometer = comparison.sensors['accelerometer']
    # The z axis bends: a line leaves several times the noise, x and y do not.
    assert accelerometer.held_out_rms[2] > 4.0 * accelerometer.noise_floor[2]
    assert (accelerometer.held_out_rms[:2] < 1.5 * accelerometer.noise_floor[:2]).all()
    with_scale = fit([*LINE, EFFECTS['scale_factor_temperature']()], [recording])
    assert any(
        'scale_factor_temperature[2] cannot be told apart from bias_temperature z' in note
        for note in with_scale.provenance.notes
    )


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ('campaign', 'sensor', 'effect', 'parameter', 'true'),
    [('practice_a', 'magnetometer', 'thermal_lag', 'time_constant', 101.4)],
)
def test_shape_parameters_of_foreign_campaigns_come_back(
    shared: Path, campaign: str, sensor: str, effect: str, parameter: str, true: float
) -> None:
    recordings = [read_bag(path) for path in sorted((shared / 'campaigns' / campaign).iterdir())]
    model = fit({sensor: (*LINE, EFFECTS[effect]())}, recordings).sensors[sensor]
    (std,) = model.shape_std[f'{effect}.{parameter}']
    assert getattr(model.effects[1], parameter) == pytest.approx(true, abs=3.0 * std)
