# SPDX-License-Identifier: Apache-2.0
"""What a thermometer in order does in a hurry is no fault of it."""

import numpy as np
import pytest
from imu_recording.recording import FloatArray, ImuRecording
from scipy.signal import lfilter
from thermal_comp.data.thermometer import instrument_faults


def recording(time: FloatArray, die: FloatArray, air: FloatArray) -> ImuRecording:
    still = np.zeros((len(time), 3))
    stamp = np.round(time * 1e9).astype(np.int64)
    noise = 0.05 * np.random.default_rng(2).standard_normal(len(time))
    counts = np.round((die + noise) / 0.0625) * 0.0625
    return ImuRecording(stamp, still, still, still, counts, chamber_temperature=air)


def following(air: FloatArray, step: float, lag: float) -> FloatArray:
    share = step / lag
    die, _ = lfilter([share], [1.0, share - 1.0], air, zi=air[:1] * (1.0 - share))
    return np.asarray(die)


def faults(some: ImuRecording) -> list[str]:
    return [fault.name for fault in instrument_faults(some)]


@pytest.mark.parametrize('lag', [100.0, 900.0, 4000.0])
def test_twenty_minutes_from_the_freezer_have_no_scale_of_their_own(lag: float) -> None:
    time = np.arange(1300.0)
    air = 22.0 - 70.0 * np.exp(-time / 60.0)
    die = following(np.concatenate([[-16.0], air[1:]]), 1.0, lag) + 6.0 * (
        1.0 - np.exp(-time / 300)
    )
    assert faults(recording(time, die, air)) == []


@pytest.mark.parametrize('scale', [0.5, 1.8])
def test_a_scale_that_cannot_be_is_found_over_a_cycle(scale: float) -> None:
    time = np.arange(0.0, 12_000.0, 2.0)
    air = 20.0 + 30.0 * np.sin(2.0 * np.pi * time / 12_000.0)
    die = 20.0 + scale * (following(air, 2.0, 300.0) - 20.0)
    assert faults(recording(time, die, air)) == ['thermometer_scale']


def test_a_thermometer_read_every_ten_seconds_holds_its_value_under_a_hair_dryer() -> None:
    time = np.arange(0.0, 600.0, 0.02)
    air = 22.0 + 30.0 * ((time % 200.0) > 100.0)
    die = following(air, 0.02, 120.0)
    held = recording(time, die[(np.arange(len(time)) // 500) * 500], air)
    counts = held.temperature[(np.arange(len(time)) // 500) * 500]
    assert faults(ImuRecording(**{**vars(held), 'temperature': counts})) == []


def test_one_that_stands_still_while_the_chamber_ramps_is_found_to_the_row() -> None:
    time = np.arange(0.0, 12_000.0, 2.0)
    air = 20.0 + 30.0 * np.sin(2.0 * np.pi * time / 12_000.0)
    sound = recording(time, following(air, 2.0, 300.0), air)
    values = sound.temperature.copy()
    values[1000:1400] = values[1000]
    (fault,) = instrument_faults(ImuRecording(**{**vars(sound), 'temperature': values}))
    assert fault.name == 'thermometer_constant'
    assert fault.rows[1000:1400].all()
    assert fault.rows.sum() <= 403


def test_a_fast_die_reads_the_same_in_two_bursts_and_is_in_order() -> None:
    bursts = [start + np.arange(0.0, 20.0, 0.1) for start in (0.0, 3600.0, 7200.0)]
    time = np.concatenate(bursts)
    air = np.where(time < 100.0, 50.0, 20.0)
    sound = recording(time, air, air)
    cold = np.where(time < 100.0, sound.temperature, 20.0)
    assert faults(ImuRecording(**{**vars(sound), 'temperature': cold})) == []
