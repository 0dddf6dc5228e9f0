# SPDX-License-Identifier: Apache-2.0
"""Clean devices raise no alarm, however they are sampled; louder noise does, where it is known."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.diagnosis.findings import clock_findings, noise_findings, ranked
from thermal_comp.diagnosis.inputs import clock_windows, slope_of_windows
from thermal_comp.diagnosis.noise_level import (
    DEFAULT_CHIP,
    NoiseReference,
    chip_references,
    is_shipped_chip,
    noise_above_reference,
)
from thermal_comp.diagnosis.result import Diagnosis, Finding
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.process import OU_TIME_CONSTANTS

from imu_recording import ImuRecording, read_bag

BAGS = Path(__file__).parents[3] / 'bags'

LONG_S = 3 * 12 * 3600.0


USUAL = chip_references()[DEFAULT_CHIP].sensors


def noise(white: float, flicker: float, sensor: str = 'gyroscope') -> NoiseModel:
    """Return a sensor's reference noise, its parts multiplied."""
    amplitudes = np.repeat(flicker * USUAL[sensor].amplitudes, len(OU_TIME_CONSTANTS), axis=0)
    return NoiseModel(white * USUAL[sensor].white, OU_TIME_CONSTANTS, amplitudes)


def above(white: float, flicker: float, duration: float = LONG_S, *, known: bool = False):
    return noise_above_reference(
        noise(white, flicker), USUAL['gyroscope'], duration=duration, bandwidth_known=known
    )


@pytest.mark.long
def test_single_samples_at_half_a_hertz_of_a_clean_device_are_complete() -> None:
    diagnosis = diagnose([read_bag(BAGS / f'dut1_{axis}') for axis in 'xyz'])
    assert diagnosis.verdict == 'complete'
    assert diagnosis.findings == ()


def test_white_noise_counts_only_where_the_bandwidth_is_known() -> None:
    assert above(5.0, 1.0) is None
    known = above(5.0, 1.0, known=True)
    assert known is not None
    assert known.white_ratio == pytest.approx(5.0)
    coloured = above(5.0, 2.0)
    assert coloured is not None
    assert coloured.evidence < known.evidence


def test_twenty_minutes_tell_too_little_of_slow_noise_to_call_it_loud() -> None:
    assert above(1.0, 2.0, 1200.0) is None
    assert above(1.0, 10.0, 1200.0) is not None


def test_a_datasheet_judges_white_noise_alone() -> None:
    mpu = chip_references()['mpu9250'].sensors
    # total rms noise of 0.1 °/s in 92 Hz of the same datasheet: one-sided density times √bandwidth
    density = np.degrees(mpu['gyroscope'].white[0]) * np.sqrt(2.0)
    assert density * np.sqrt(92.0) == pytest.approx(0.1, rel=0.05)
    loud = NoiseModel(
        2.0 * mpu['gyroscope'].white, OU_TIME_CONSTANTS, np.ones((len(OU_TIME_CONSTANTS), 3))
    )
    found = noise_above_reference(loud, mpu['gyroscope'], duration=LONG_S, bandwidth_known=True)
    assert found is not None
    assert (found.white_ratio, found.flicker_ratio) == (pytest.approx(2.0), None)
    assert noise_above_reference(loud, mpu['gyroscope'], duration=LONG_S) is None


def clocked(slope: float, *, gap_every: int | None) -> ImuRecording:
    """Return 4 h at 1 Hz whose interval follows the temperature, with or without gaps."""
    n = 14_400
    temperature = 20.0 + 20.0 * np.sin(2.0 * np.pi * np.arange(n) / n)
    step = 1.0 + slope * (temperature - 20.0)
    step += np.random.default_rng(4).normal(0.0, 1e-4, n)
    if gap_every:
        step[::gap_every] += 2.0
    stamp = np.round(np.cumsum(step) * 1e9).astype(np.int64)
    still = np.zeros((n, 3))
    return ImuRecording(stamp, still, still, still, temperature)


def test_a_run_of_gaps_has_no_say_about_the_clock_and_no_warning() -> None:
    sound = clocked(1e-5, gap_every=None)
    broken = clocked(1e-5, gap_every=50)
    nowhere = replace(sound, temperature=np.full(len(sound), np.nan))
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        broken_windows, sound_windows = clock_windows(broken), clock_windows(sound)
        assert slope_of_windows([broken_windows]) is None
        assert slope_of_windows([clock_windows(nowhere), broken_windows]) is None
        both = slope_of_windows([broken_windows, sound_windows])
        alone = slope_of_windows([sound_windows])
    assert both == alone
    assert alone is not None
    assert alone.slope == pytest.approx(1e-5, rel=0.05)


def found_beside(clock: float, *others: Finding) -> Diagnosis:
    """Return the findings of a clock with a slope [1/K] beside others."""
    found = clock_findings(slope_of_windows([clock_windows(clocked(clock, gap_every=None))]))
    assert [f.name for f in found] == ['clock_temperature']
    return replace(Diagnosis('dut1', (), {}, {}), findings=ranked([*found, *others]))


def test_a_clock_that_follows_the_temperature_as_clocks_do_is_no_missing_effect() -> None:
    assert found_beside(40e-6).verdict == 'complete'
    assert 'as RC oscillators do' in found_beside(40e-6).findings[0].text
    assert found_beside(4e-4).verdict == 'missing'


@pytest.mark.parametrize('slope', [40e-6, 4e-4])
def test_a_clock_never_heads_what_a_sensor_lacks(slope: float) -> None:
    unlogged = Finding('unlogged', None, 'gyroscope', 12.0, depends_on='chamber')
    found = found_beside(slope, unlogged)
    assert (found.verdict, found.findings[0]) == ('unlogged', unlogged)


def test_noise_of_another_chip_is_not_measured_by_this_ones() -> None:
    louder = {sensor: noise(3.0, 9.0, sensor) for sensor in USUAL}
    assert not is_shipped_chip(louder)
    usual = noise(1.0, 0.0, 'accelerometer')
    assert is_shipped_chip({**louder, 'gyroscope': noise(1.2, 9.0), 'accelerometer': usual})


def test_a_sensor_that_the_reference_does_not_hold_is_not_measured_by_the_table() -> None:
    louder = {'gyroscope': noise(9.0, 9.0)}
    runs = prepare([read_bag(BAGS / 'dut1_x')])
    comparison = compare_prepared(fit_prepared([BiasTemperature()], runs), runs)
    long = {'duration': LONG_S, 'bandwidth_known': True}
    other = NoiseReference('dut7', {'accelerometer': noise(1.0, 1.0)})
    assert noise_findings(louder, comparison, other, **long) == {}
    same = NoiseReference('dut7', {'gyroscope': noise(1.0, 1.0)})
    found = noise_findings(louder, comparison, same, **long)
    assert 'noise above that of dut7, white × 9.00, bias' in found['gyroscope'].text
    chip = noise_findings(louder, comparison, chip_references()['mpu9250'], **long)
    assert chip['gyroscope'].text.startswith('gyroscope: noise above that of MPU-9250, white × ')
    assert 'bias instability' not in chip['gyroscope'].text
    assert noise_findings(louder, comparison, chip_references()['icm20948'], **long) == {}
