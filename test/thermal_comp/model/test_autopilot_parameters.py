# SPDX-License-Identifier: Apache-2.0
"""Cubics for autopilots: what they keep, their files read back, and applied as they do."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from thermal_comp.model.export.ardupilot import ardupilot_text, read_ardupilot
from thermal_comp.model.export.cubic import Cubic, fitted_cubic, loss, reduced
from thermal_comp.model.export.kalibr import densities, kalibr_text
from thermal_comp.model.export.px4 import px4_text, read_px4
from thermal_comp.model.values import ModelError, NoiseModel, SensorModel, ThermalModel

from imu_recording import read_bag

NOISE = NoiseModel(
    np.array([1e-3, 2e-3, 1e-3]), np.array([20.0, 500.0]), np.array([[0.0] * 3, [1e-4] * 3])
)


def model_of(**coefficients: np.ndarray) -> ThermalModel:
    effects = tuple(EFFECTS[name]() for name in coefficients)
    part = SensorModel(
        effects=effects,
        coefficients=tuple(coefficients.values()),
        covariance=np.zeros((0, 0)),
        noise=NOISE,
        contributions={'supply_sensitivity': np.array([1e-3, 2e-3, 1e-3])},
        temperature_range=(-10.0, 50.0),
    )
    return ThermalModel('dut1', {'accelerometer': part, 'gyroscope': part})


LINE = np.array([[2e-3, -1e-3, 5e-4]])
CURVE = np.array([[1e-5, -2e-5, 3e-5], [1e-7, 2e-7, -3e-7]])
CUBIC = model_of(bias_temperature=LINE, bias_temperature_curvature=CURVE)


def test_a_cubic_model_is_kept_whole() -> None:
    cubic = reduced(CUBIC, 'gyroscope')
    temperature = np.linspace(-10.0, 50.0, 13)
    x = (temperature - 20.0)[:, None]
    expected = LINE * x + CURVE[0] * x**2 + CURVE[1] * x**3
    np.testing.assert_allclose(cubic.error(temperature), expected, atol=1e-12)
    np.testing.assert_allclose(cubic.about(35.0).error(temperature), expected, atol=1e-12)
    lost = loss(CUBIC, 'gyroscope', cubic)
    assert lost.kept == pytest.approx(1.0, abs=1e-9)
    assert lost.costs == {}


def test_a_lag_costs_its_rate_times_its_time_constant() -> None:
    lagging = np.array([[4e-3, 1e-3, 0.0]])
    model = model_of(bias_temperature=LINE, thermal_lag=lagging)
    lost = loss(model, 'accelerometer', reduced(model, 'accelerometer'))
    behind = 300.0 * 2.0 / 60.0  # K, in a ramp of 2 K/min
    assert list(lost.costs) == ['thermal_lag']
    assert lost.costs['thermal_lag'] == pytest.approx(behind * 4e-3, rel=0.25)
    assert 0.3 < lost.kept < 0.8


def test_what_an_autopilot_does_not_follow_is_said() -> None:
    supply = np.array([[0.1, 0.2, 0.1]])
    model = model_of(bias_temperature=LINE, supply_sensitivity=supply, warm_up=0.01 * LINE / 2e-3)
    lost = loss(model, 'accelerometer', reduced(model, 'accelerometer'))
    assert lost.not_followed == ('supply_sensitivity',)
    assert lost.costs['supply_sensitivity'] == 2e-3
    assert lost.costs['warm_up'] == pytest.approx(0.01, rel=0.05)  # at power-on
    assert lost.kept > 0.99  # long after it


def test_a_scale_factor_is_no_bias() -> None:
    model = model_of(bias_temperature=LINE, scale_factor_temperature=np.full(3, 1e-4))
    cubic = reduced(model, 'accelerometer')
    np.testing.assert_allclose(cubic.about(20.0).coefficients[1], LINE[0], rtol=1e-9)
    lost = loss(model, 'accelerometer', cubic)
    assert lost.costs['scale_factor_temperature'] == pytest.approx(1e-4 * 30.0 * 9.80665, rel=1e-3)


def ulps(one: np.ndarray, other: np.ndarray) -> float:
    """Greatest distance in units of the last place of single precision."""
    a, b = np.float32(one), np.float32(other)
    return float(np.max(np.abs(a - b) / np.spacing(np.maximum(np.abs(a), np.float32(1e-30)))))


def test_px4_file_reads_back() -> None:
    cubics = {s: reduced(CUBIC, s) for s in ('accelerometer', 'gyroscope')}
    text = px4_text(cubics, 2, {'gyroscope': 3670050}, 'test')
    read = read_px4(text, 2)
    for sensor, cubic in cubics.items():
        assert ulps(cubic.coefficients, read[sensor].coefficients) <= 1.0
        ends = np.array([cubic.reference, cubic.low, cubic.high])
        other = read[sensor]
        assert ulps(ends, np.array([other.reference, other.low, other.high])) <= 1.0
    rows = [line.split('\t') for line in text.splitlines() if not line.startswith('#')]
    assert all(len(row) == 5 and row[:2] == ['1', '1'] for row in rows)
    kinds = {row[2]: row[4] for row in rows}
    assert kinds['TC_G2_ID'] == '6' == kinds['TC_A_ENABLE']
    assert kinds['TC_A2_X3_2'] == '9'
    assert 'TC_A2_ID' not in kinds
    assert read_px4(text, 0) == {}
    with pytest.raises(ModelError, match='TC_A2_TMIN'):
        read_px4(text.replace('TC_A2_TMIN', 'OTHER'), 2)


def test_px4_subtracts_what_the_cubic_says() -> None:
    """In single precision and in the order of powers PX4 computes with."""
    cubic = reduced(CUBIC, 'accelerometer')
    read = read_px4(px4_text({'accelerometer': cubic}, 0, {}, ''), 0)['accelerometer']
    x0, x1, x2, x3 = np.float32(read.coefficients)
    for temperature in (-20.0, -5.0, 12.5, 49.0, 60.0):
        held = np.float32(min(max(temperature, read.low), read.high))
        d = held - np.float32(read.reference)
        offset = x0 + x1 * d + x2 * (d * d) + x3 * (d * d * d)
        np.testing.assert_allclose(offset, cubic.error(np.array([temperature]))[0], atol=2e-7)


def test_ardupilot_file_reads_back_and_subtracts_the_change_since_its_calibration() -> None:
    cubics = {s: reduced(CUBIC, s) for s in ('accelerometer', 'gyroscope')}
    text = ardupilot_text(cubics, 0, 'test')
    read = read_ardupilot(text, 0)
    for sensor, cubic in cubics.items():
        exact = 1e6 * cubic.about(35.0).coefficients[1:]
        assert ulps(exact, 1e6 * read[sensor].coefficients[1:]) <= 1.0
        t, calibrated = np.array([12.5]), np.array([31.0])
        change = read[sensor].error(t) - read[sensor].error(calibrated)
        expected = cubic.error(t) - cubic.error(calibrated)
        np.testing.assert_allclose(change, expected, atol=1e-7)
    lines = dict(line.split() for line in text.splitlines()[1:])
    assert len(lines) == 3 + 18
    assert lines['INS_TCAL1_ENABLE'] == '1'
    x = 1e6 * (LINE[0, 1] + 2 * CURVE[0, 1] * 15.0 + 3 * CURVE[1, 1] * 15.0**2)
    assert float(lines['INS_TCAL1_GYR1_Y']) == pytest.approx(x, rel=1e-6)
    assert not any('e' in value for value in lines.values())


def test_ardupilot_range_stays_within_what_it_takes() -> None:
    wide = replace(reduced(CUBIC, 'gyroscope'), low=-80.0, high=85.0)
    cubic = read_ardupilot(ardupilot_text({'gyroscope': wide}, 1, ''), 1)['gyroscope']
    assert (cubic.low, cubic.high) == (-70.0, 80.0)


def test_kalibr_file_holds_the_worst_axis() -> None:
    content = yaml.safe_load(kalibr_text(CUBIC, 200.0, '/imu0', 'test'))
    assert content['gyroscope_noise_density'] == pytest.approx(2e-3)
    assert content['gyroscope_random_walk'] == pytest.approx(1e-4 * math.sqrt(2.0 / 500.0))
    assert (content['rostopic'], content['update_rate']) == ('/imu0', 200)
    white, walk = densities(replace(NOISE, amplitudes=np.full((2, 3), 1e-4)))
    assert white[0] == pytest.approx(math.sqrt(1e-6 + 2.0 * 20.0 * 1e-8))
    assert walk[0] == pytest.approx(1e-4 * math.sqrt(2.0 / 500.0))


def test_kalibr_density_is_that_of_the_simulated_noise() -> None:
    """The random walk is the growth of the variance of a simulated process, early on."""
    tau, sigma, n = 1000.0, 0.3, 4000
    rng = np.random.default_rng(4)
    decay = math.exp(-1.0 / tau)
    start = rng.normal(0.0, sigma, n)
    x = start
    for _ in range(10):  # seconds
        x = decay * x + rng.normal(0.0, sigma * math.sqrt(1.0 - decay**2), n)
    grown = np.var(x - start) / 10.0
    noise = NoiseModel(np.zeros(3), np.array([tau]), np.full((1, 3), sigma))
    assert densities(noise)[1][0] ** 2 == pytest.approx(grown, rel=0.1)


def test_the_fitted_cubic_is_judged_on_parts_it_has_not_seen(bags: Path) -> None:
    recordings = [read_bag(bags / f'hidden_effect_{axis}') for axis in 'xyz']
    effects = [EFFECTS['bias_temperature'](), EFFECTS['thermal_lag'](74.0)]
    model = fit(effects, recordings)
    cubics, held_out = fitted_cubic(model, prepare(recordings))
    cubic, whole = held_out['accelerometer']
    assert np.all(cubic > 5.0 * whole)  # the hidden lag is none of temperature's
    assert isinstance(cubics['gyroscope'], Cubic)
    t = np.linspace(0.0, 45.0, 10)
    line = model.sensors['gyroscope'].coefficients[0] * (t - 20.0)[:, None]
    np.testing.assert_allclose(cubics['gyroscope'].error(t), line, atol=2e-5)
