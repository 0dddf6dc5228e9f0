# SPDX-License-Identifier: Apache-2.0
"""A thermometer that is read less often than rows are written is seen by what it wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.held_temperature import measurement_stamps
from imu_recording.recording import FloatArray
from imu_recording.tables.csv_import import import_csv
from recording_samples import imu, make_bag, temperature
from scipy.signal import lfilter

from imu_recording import read_bag

MAPPING = {
    'schema': 1,
    'time': {'column': 't', 'unit': 's'},
    'columns': {
        'linear_acceleration': {'columns': ['ax', 'ay', 'az'], 'unit': 'm/s²'},
        'angular_velocity': {'columns': ['gx', 'gy', 'gz'], 'unit': 'rad/s'},
        'temperature': {'column': 'T', 'unit': '°C'},
    },
}


def warmed(rate: float) -> tuple[FloatArray, FloatArray]:
    """Time [s] and temperature [°C] of a device that follows ramps and dwells of a chamber."""
    time = np.arange(0.0, 1800.0, 1.0 / rate)
    chamber = 20.0 + 15.0 * np.interp(time, [0, 300, 600, 900, 1500], [0, 0, 1, 1, -1])
    share = 1.0 - np.exp(-1.0 / (200.0 * rate))
    device = lfilter([share], [1.0, share - 1.0], chamber, zi=chamber[:1] * (1.0 - share))[0]
    return time, device


def held(values: FloatArray, starts: FloatArray) -> FloatArray:
    """Return values (n,) of which only those at some rows are kept, each until the next."""
    rows = starts.astype(int)
    return np.repeat(values[rows], np.diff(np.append(rows, len(values))))


@pytest.mark.parametrize('rate', [5.0, 50.0, 100.0])
@pytest.mark.parametrize('noise', [0.0, 0.003, 0.05])
@pytest.mark.parametrize('resolution', [0.0, 1 / 512, 1 / 16, 0.1, 0.5])
def test_a_thermometer_read_for_every_row_is_not_called_slow(
    rate: float, noise: float, resolution: float
) -> None:
    time, values = warmed(rate)
    values = values + noise * np.random.default_rng(1).normal(size=len(values))
    if resolution:
        values = np.round(values / resolution) * resolution
    assert measurement_stamps((time * 1e9).astype(np.int64), values) is None


@pytest.mark.parametrize(('rate', 'period'), [(100.0, 1.0), (50.0, 0.2), (10.0, 1.0), (50.0, 5.0)])
@pytest.mark.parametrize('resolution', [0.0, 1 / 512])
def test_values_are_of_the_row_that_changed(rate: float, period: float, resolution: float) -> None:
    time, values = warmed(rate)
    values = values + 0.003 * np.random.default_rng(1).normal(size=len(values))
    if resolution:
        values = np.round(values / resolution) * resolution
    starts = np.arange(0, len(time), round(period * rate))
    stamp = (time * 1e9).astype(np.int64)
    found = measurement_stamps(stamp, held(values, starts))
    assert found is not None
    # A value that is measured twice in a row is of two times, to a row.
    late = (found - held(stamp, starts)) * 1e-9
    assert np.abs(late).max() < 1.5 / rate


def test_a_reader_that_is_not_in_step_with_the_rows_is_seen_too() -> None:
    time, values = warmed(100.0)
    starts = np.ceil(np.arange(0.0, len(time) - 1.0, 100.7))  # its own clock is 0.7 % slow
    found = measurement_stamps((time * 1e9).astype(np.int64), held(values, starts))
    assert found is not None
    assert np.median(np.diff(np.unique(found))) == pytest.approx(1.007e9, abs=0.01e9)


def test_a_file_that_repeats_a_slow_thermometer_says_so(tmp_path: Path) -> None:
    time, values = warmed(10.0)
    slow = held(values, np.arange(0, len(time), 10))
    rows = np.column_stack([time, np.tile([0, 0, 9.8, 0, 0, 0], (len(time), 1)), slow])
    file = tmp_path / 'a.csv'
    np.savetxt(file, rows, delimiter=',', header='t,ax,ay,az,gx,gy,gz,T', comments='')
    recording = import_csv(file, MAPPING)
    assert 'temperature: measured every 1 s and repeated between' in recording.notes
    assert recording.temperature_stamp is not None
    age = (recording.stamp - recording.temperature_stamp) * 1e-9
    assert age.max() == pytest.approx(0.9)


def test_a_bag_that_repeats_a_slow_thermometer_says_so(tmp_path: Path) -> None:
    messages = []
    for i in range(2000):
        stamp = i * 100_000_000
        messages.append(('/imu/data_raw', stamp, imu(stamp, 1.0)))
        value = 20.0 + 0.37 * np.sin(i // 10)
        messages.append(('/imu/temperature', stamp, temperature(stamp, value)))
    recording = read_bag(make_bag(tmp_path / 'b', messages))
    assert 'temperature: measured every 1 s and repeated between' in recording.notes
    assert recording.temperature_stamp is not None
    assert recording.temperature_stamp[:21].tolist() == [0] * 10 + [10**9] * 10 + [2 * 10**9]
