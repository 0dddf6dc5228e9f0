# SPDX-License-Identifier: Apache-2.0
"""Faults of a die's thermometer, in a recording and in a stream, and none in one that is sound."""

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import FloatArray, ImuRecording
from scipy.signal import lfilter
from thermal_comp.data.thermometer import ThermometerComparison, instrument_faults


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


def test_a_second_thermometer_in_the_air_tells_of_a_wrong_scale_too() -> None:
    time = np.arange(0.0, 12_000.0, 2.0)
    air = 20.0 + 30.0 * np.sin(2.0 * np.pi * time / 12_000.0)
    some = recording(time, 20.0 + 1.8 * (following(air, 2.0, 300.0) - 20.0), air)
    second = replace(some, chamber_temperature=None, chamber_temperature_2=air)
    assert faults(second) == ['thermometer_scale']
    at_the_device = replace(second, device_temperature=some.temperature - 0.2)
    assert faults(at_the_device) == []


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


@pytest.mark.parametrize(('over', 'settling', 'lag'), [(3.0, 900.0, 400.0), (4.0, 300.0, 200.0)])
def test_a_coarse_thermometer_holds_a_count_while_its_die_turns(
    over: float, settling: float, lag: float
) -> None:
    """After a ramp the air overshoots: fast dies go back with it, slow ones still come."""
    time = np.arange(0.0, 9000.0, 2.0)
    ramp = np.clip((time - 1000.0) / 900.0, 0.0, 1.0)
    air = 20.0 + ramp * (30.0 + over * np.exp(-np.maximum(time - 1900.0, 0.0) / settling))
    sound = recording(time, following(air, 2.0, lag), air)
    counts = 0.5 * np.round(sound.temperature / 0.5)
    assert faults(ImuRecording(**{**vars(sound), 'temperature': counts})) == []


def test_a_fast_die_reads_the_same_in_two_bursts_and_is_in_order() -> None:
    bursts = [start + np.arange(0.0, 20.0, 0.1) for start in (0.0, 3600.0, 7200.0)]
    time = np.concatenate(bursts)
    air = np.where(time < 100.0, 50.0, 20.0)
    sound = recording(time, air, air)
    cold = np.where(time < 100.0, sound.temperature, 20.0)
    assert faults(ImuRecording(**{**vars(sound), 'temperature': cold})) == []


SECOND = 1_000_000_000
SEEDS = range(8)


def watched(seed: int, fault: str) -> ThermometerComparison:
    """One hour: a robot's surroundings change by 15 K, its die follows 8 K warmer, lagging.

    The surroundings are measured every second in steps of 0.01 K, the die five times a second
    in steps of 1/16 K. Messages of the first may come after those of the second that were
    measured later.
    """
    rng = np.random.default_rng((seed, 15))
    comparison = ThermometerComparison()
    lag, span, swing = rng.uniform(100.0, 900.0), rng.uniform(12.0, 20.0), rng.uniform(2e3, 4e3)
    base = rng.uniform(0.0, 30.0)
    scale = {'scale': rng.choice([1.8, 0.1])}.get(fault, 1.0)
    seconds = np.arange(3600)
    truth = base + 0.5 * span * (1.0 - np.cos(2 * np.pi * seconds / swing))
    air = np.round(truth + rng.normal(0.0, 0.02, 3600), 2)
    followed, _ = lfilter(
        [1.0 / lag], [1.0, 1.0 / lag - 1.0], truth, zi=[base * (1.0 - 1.0 / lag)]
    )
    read = followed[:, None] * scale + 8.0 + rng.normal(0.0, 0.05, (3600, 5))
    shown = np.round(read * 16.0) / 16.0
    if fault == 'copy':
        shown[:] = air[:, None]
    late = rng.random(3600) < 0.5
    for second in range(3600):
        for k, value in enumerate(shown[second].tolist()):
            if k == 2 * late[second]:
                comparison.on_other('device_temperature', second * SECOND, float(air[second]))
            comparison.on_die(second * SECOND + k * SECOND // 5, value)
    return comparison


@pytest.mark.parametrize(
    ('fault', 'said'), [('', ''), ('copy', 'a copy of device_temperature'), ('scale', 'scale')]
)
def test_each_fault_is_found_and_none_in_a_sound_stream(fault: str, said: str) -> None:
    told = [watched(seed, fault).fault for seed in SEEDS]
    right = [said in text if said else not text for text in told]
    assert np.mean(right) == 1.0, told


def test_a_stream_without_other_thermometers_says_nothing() -> None:
    comparison = ThermometerComparison()
    for second in range(1000):
        comparison.on_die(second * SECOND, 20.0 + second / 16)
    assert comparison.fault == ''
