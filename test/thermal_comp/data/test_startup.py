# SPDX-License-Identifier: Apache-2.0
"""What is cut at the start: filters that fill up, rows whose temperature was not read yet."""

import numpy as np
import pytest
from thermal_comp.data.startup import cut_startup, decay_of, startup_rows

from imu_recording import ImuRecording

TIME = np.arange(0.0, 8000.0, 10.0)
LEVELS = np.array([9.8, -0.2, 0.35, 22.0, -40.0])


def noisy(values: np.ndarray) -> np.ndarray:
    return values + 1e-4 * np.abs(LEVELS) * np.random.default_rng(4).normal(size=values.shape)


@pytest.mark.parametrize(('share', 'time_constant'), [(0.3, 150.0), (0.8, 400.0)])
def test_share_and_time_constant_are_those_put_in(share: float, time_constant: float) -> None:
    values = LEVELS * (1.0 - share * np.exp(-TIME / time_constant))[:, None]
    found = decay_of(TIME, noisy(values))
    assert found is not None
    assert found == pytest.approx((share, time_constant), rel=0.05)


def test_a_temperature_moves_each_channel_by_its_own_amount() -> None:
    moved = np.array([0.1, -0.5, 0.9, -0.2, 0.4])
    values = LEVELS * (1.0 - moved * np.exp(-TIME / 300.0)[:, None])
    assert decay_of(TIME, noisy(values)) is None


def test_a_level_that_is_there_from_the_start_has_none() -> None:
    assert decay_of(TIME, noisy(np.tile(LEVELS, (len(TIME), 1)))) is None


def test_what_is_not_seen_twice_as_long_is_not_judged() -> None:
    values = LEVELS * (1.0 - 0.5 * np.exp(-TIME / 150.0))[:, None]
    soon = TIME < 1000.0
    assert decay_of(TIME[soon], noisy(values)[soon]) is None


def read_from(row: int, **changed: np.ndarray) -> ImuRecording:
    """Return a recording of 400 s whose thermometer shows 25 °C until a row, then what is."""
    stamp = np.arange(400) * 10**9
    die = 41.0 + 0.02 * np.arange(400.0)
    die[:row] = 25.0
    still = np.zeros((400, 3))
    return ImuRecording(stamp, still, still + 9.8, still, changed.get('temperature', die))


@pytest.mark.parametrize(('row', 'below'), [(1, '16.0'), (15, '16.3')])
def test_rows_before_a_thermometer_was_read_are_cut(row: int, below: str) -> None:
    cut = cut_startup(read_from(row))
    assert len(cut) == 400 - row
    assert cut.notes[0].endswith(f'their temperature {below} K below the next')


def test_a_thermometer_that_jumps_late_or_again_and_again_is_left_alone() -> None:
    assert startup_rows(read_from(100))[0] == 0
    coarse = np.floor(np.arange(400.0) / 8.0)
    assert startup_rows(read_from(0, temperature=coarse))[0] == 0
