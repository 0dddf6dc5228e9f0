# SPDX-License-Identifier: Apache-2.0
"""Noise that was put in comes out of the Allan deviation, in the units of IEEE 952."""

import math
from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.certificate.allan import (
    COEFFICIENTS,
    allan_content,
    allan_curves,
    allan_deviation,
    allan_deviations,
    coefficients,
    datasheet_noise,
    rows_note,
    without_density,
)
from imu_workbench.report.figures.modelled import allan_deviation_figure
from imu_workbench.report.laboratory import Laboratory

PERIOD = 0.5


def pieces(make, runs: int = 3, n: int = 20_000):
    return [(make(np.random.default_rng(seed), n), PERIOD) for seed in range(runs)]


def test_white_noise_is_angle_random_walk() -> None:
    density = 2e-4  # rad/s·√s
    found = allan_deviation(
        pieces(lambda rng, n: 3.0 + rng.normal(0.0, density / math.sqrt(PERIOD), n))
    )
    assert found is not None
    told = coefficients(found)
    value, low, high = told['random_walk']
    assert low < density < high
    assert value == pytest.approx(density, rel=0.02)
    value, low, most = told['rate_random_walk']
    longest = float(found.taus[-1])
    assert value <= most < 2.0 * density * math.sqrt(3.0) / longest
    assert low == 0.0
    factor = COEFFICIENTS['random_walk']['gyroscope'][2]
    assert factor * density == pytest.approx(math.degrees(density) * 60.0)


def test_a_random_walk_is_told_beside_white_noise() -> None:
    walk = 3e-6  # rad/s/√s

    def make(rng, n):
        steps = rng.normal(0.0, walk * math.sqrt(PERIOD), n)
        return np.cumsum(steps) + rng.normal(0.0, 1e-4, n)

    found = allan_deviation(pieces(make, runs=6))
    assert found is not None
    value, low, high = coefficients(found)['rate_random_walk']
    assert low < walk < high
    assert value == pytest.approx(walk, rel=0.35)


def test_intervals_hold_the_density_as_often_as_they_say() -> None:
    hits = 0
    for seed in range(200):
        values = np.random.default_rng(seed).normal(0.0, 1.0, 2000)
        found = allan_deviation([(values, 1.0)])
        assert found is not None
        _, low, high = coefficients(found)['random_walk']
        hits += low < 1.0 < high
    assert 0.90 < hits / 200 <= 1.0


def test_white_noise_below_slow_noise_is_bounded_by_the_whole_deviation() -> None:
    """At 5 s a flicker noise hides it: it is no more than the deviation there allows."""
    density, period = 1.0, 5.0

    def make(rng, n):
        spectrum = np.fft.rfft(rng.normal(0.0, 1.0, n))
        spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)) / n)
        return rng.normal(0.0, density / math.sqrt(period), n) + np.fft.irfft(spectrum, n)

    found = allan_deviation([(make(np.random.default_rng(k), 4096), period) for k in range(3)])
    assert found is not None
    value, low, high = coefficients(found)['random_walk']
    assert low == 0.0 < density < high
    assert value <= high
    assert high == pytest.approx(found.interval()[1][0] * math.sqrt(period), rel=1e-6)


def test_rows_that_may_be_single_samples_say_what_is_open(run) -> None:
    slow = run('dut1', 'z', cycles=3)
    assert 'up to 1 s apart' in rows_note([slow])
    assert rows_note([replace(slow, vibration=np.zeros((len(slow), 3)))]) == ''


def test_too_little_has_none() -> None:
    assert allan_deviation([]) is None


def test_a_simulated_device_shows_its_noise(run) -> None:
    recordings = [run('dut1', up, seed=i, cycles=3) for i, up in enumerate('xz')]
    certified = analyse_recordings(recordings, attitudes=False, diagnosis=False).certified['dut1']
    stated = {'gyroscope': {'random_walk': 0.3}}
    deviations = allan_deviations(certified.model, certified.runs)
    rows = allan_content(deviations, stated)
    row = next(r for r in rows if r['coefficient'] == 'angle random walk')
    assert row['datasheet'] == pytest.approx(0.3)
    for axis in row['axes']:  # noise 1e-4 rad/s at 1 Hz
        assert axis[0] == pytest.approx(math.degrees(1e-4) * 60.0, rel=0.1)

    density = next(r for r in rows if r['coefficient'] == 'noise density')
    assert density['unit'] == '°/s/√Hz'
    assert density['datasheet'] == pytest.approx(0.3 / 60.0 * math.sqrt(2.0))
    for axis in density['axes']:
        assert axis[0] == pytest.approx(math.degrees(1e-4) * math.sqrt(2.0), rel=0.1)

    curves = allan_curves(deviations)
    for line in curves['gyroscope'].values():
        assert line['deviation'][0] == pytest.approx(math.degrees(1e-4), rel=0.1)  # of 1 s
        assert all(
            low < value < high
            for low, value, high in zip(line['low'], line['deviation'], line['high'], strict=True)
        )
    figure = allan_deviation_figure(curves)
    drawn = [trace for trace in figure['data'] if trace.get('fill') is None]
    assert [t['y'] for t in drawn[:3]] == [c['deviation'] for c in curves['gyroscope'].values()]
    assert figure['layout']['xaxis']['type'] == figure['layout']['yaxis']['type'] == 'log'


def test_the_datasheet_is_the_laboratorys_else_that_of_the_chip_it_names() -> None:
    known = datasheet_noise(Laboratory({'device': {'type': 'InvenSense MPU-9250'}}))
    # 0.01 °/s/√Hz and 300 µg/√Hz, one-sided
    assert known['gyroscope']['random_walk'] == pytest.approx(0.01 * 60.0 / math.sqrt(2.0))
    velocity = 300e-6 * 9.80665 * 60.0 / math.sqrt(2.0)
    assert known['accelerometer']['random_walk'] == pytest.approx(velocity)
    assert known['magnetometer'] == {}
    stated = {'gyroscope': {'random_walk': 0.3, 'bias_instability': 9.0}}
    given = {'device': {'type': 'MPU-9250'}, 'datasheet': stated}
    assert datasheet_noise(Laboratory(given))['gyroscope'] == stated['gyroscope']
    measured = datasheet_noise(Laboratory({'device': {'type': 'LSM9DS1'}}))  # of no datasheet
    assert not any(measured.values())
    assert not any(datasheet_noise(Laboratory()).values())
    assert without_density(Laboratory({'device': {'type': 'LSM9DS1'}})) == 'LSM9DS1'
    assert without_density(Laboratory(given)) == without_density(Laboratory()) == ''
