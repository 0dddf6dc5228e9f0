# SPDX-License-Identifier: Apache-2.0
"""A line is an alias of the mains while it keeps its phase or follows the temperature."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from thermal_comp.data.blocks import in_search_blocks
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import LOWEST_HZ, SpectralLine, spectral_lines
from thermal_comp.diagnosis.evidence.effect_sets import NOT_IN_CATALOGUE
from thermal_comp.diagnosis.evidence.posterior import probability
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.diagnosis.sensor_search import (
    Settings,
    search_sensors,
)
from thermal_comp.effects import EFFECTS
from thermal_comp.noise.estimation import fit_noise

from ..campaign import PERIOD, WHITE, chamber, lagging, run

GAINS = np.array([1.0, -0.7, 0.8])
HERTZ = 0.0071
SENSOR = 'magnetometer'


@cache
def runs_with(line: Callable[[], np.ndarray]) -> list[PreparedRun]:
    size = 2.0 * WHITE['magnetic_field']
    error = {'magnetic_field': size * np.multiply.outer(line(), GAINS)}
    return prepare([run(up, seed=k, error=error) for k, up in enumerate(('+x', '+z'))])


@cache
def decided(line: Callable[[], np.ndarray]) -> SensorAnswer:
    runs = runs_with(line)
    catalogue = {name: EFFECTS[name] for name in ('mains_alias', 'warm_up')}
    base = {SENSOR: (EFFECTS['bias_temperature'](),)}
    return search_sensors(runs, base, {SENSOR: fit_noise(runs, SENSOR)}, Settings(catalogue))[
        SENSOR
    ]


def steady() -> np.ndarray:
    return np.asarray(np.cos(2.0 * np.pi * HERTZ * chamber()[0]))


def gated() -> np.ndarray:
    """A current that flows half of the time, an hour long."""
    return np.asarray(steady() * (chamber()[0] // 3600 % 2))


DRIFT = 1.4e-5
"""[Hz/K]"""


def drifting() -> np.ndarray:
    """A beat of two clocks, one of which feels the temperature."""
    frequency = 5.0 * HERTZ + DRIFT * (chamber()[1] - 20.0)
    return np.asarray(np.cos(2.0 * np.pi * np.cumsum(frequency) * PERIOD))


def wandering() -> np.ndarray:
    """A machine whose speed walks at random."""
    walk = np.random.default_rng(5).normal(size=len(chamber()[0])).cumsum()
    frequency = 5.0 * HERTZ + 1e-5 * walk
    return np.asarray(np.cos(2.0 * np.pi * np.cumsum(frequency) * PERIOD))


def test_a_line_that_keeps_its_phase_is_named() -> None:
    (named,) = decided(steady).named
    assert named.name == 'mains_alias'
    assert named.shape_parameters['frequency'] == pytest.approx(HERTZ, abs=3e-6)


def test_a_line_that_stands_still_may_be_another_oscillation_one_that_moves_may_not() -> None:
    unnamed = [
        probability(decided(line).explanations, lambda e: e.names == (NOT_IN_CATALOGUE,))
        for line in (steady, drifting)
    ]
    assert 0.1 < unnamed[0] < 0.3
    assert unnamed[1] < 0.05


def test_a_line_that_comes_and_goes_keeps_its_name_as_approximate() -> None:
    answer = decided(gated)
    assert [effect.name for effect in answer.named] == ['mains_alias']
    assert answer.likeliest.approximate


def test_a_line_that_follows_the_temperature_is_named_with_its_drift() -> None:
    (named,) = decided(drifting).named
    assert named.name == 'mains_alias'
    assert named.shape_parameters['frequency'] == pytest.approx(5.0 * HERTZ, abs=3e-6)
    assert named.shape_parameters['drift'] == pytest.approx(DRIFT, abs=1e-6)


def test_a_line_that_wanders_is_not() -> None:
    answer = decided(wandering)
    assert (answer.kind, answer.named) == ('unexplained', ())
    assert answer.likeliest.depends_on == 'frequency'


def test_the_strongest_line_is_found_where_it_is() -> None:
    (strongest, *_) = spectral_lines(runs_with(steady), SENSOR)
    assert strongest.frequency == pytest.approx(HERTZ, abs=3e-6)
    assert strongest.drift == 0.0


def test_a_drift_is_found_as_closely_as_days_of_rows_tell() -> None:
    time = 10.0 * np.arange(22_000)
    temperature = 25.0 + 7.0 * np.cos(2.0 * np.pi * time / 110_000.0)
    frequency, drift = 0.01429, 4.93e-6
    phase = 2.0 * np.pi * np.cumsum(frequency + drift * (temperature - 20.0)) * 10.0
    field = 3.0 * np.multiply.outer(np.cos(phase), GAINS)
    field += np.random.default_rng(2).standard_normal(field.shape)
    stamp = np.round(time * 1e9).astype(np.int64)
    at_rest = np.zeros_like(field)
    room = ImuRecording(
        stamp=stamp,
        temperature=temperature,
        linear_acceleration=at_rest + [0.0, 0.0, 9.8],
        angular_velocity=at_rest,
        magnetic_field=1e-7 * field,
        up_axis='+z',
    )
    (strongest, *_) = spectral_lines(prepare([room]), SENSOR)
    assert strongest.drift == pytest.approx(drift, abs=2e-7)
    assert strongest.frequency == pytest.approx(frequency, abs=1e-6)


def test_a_strong_line_that_moves_only_while_a_device_warms_up_is_found_with_its_drift() -> None:
    time = np.arange(0.0, 1500.0)
    die = -8.0 + 29.0 * (1.0 - np.exp(-time / 250.0))
    angle = 2.0 * np.pi * np.cumsum(0.28 - 1.4e-4 * (die - 20.0))
    rng = np.random.default_rng(2)
    stamp = np.round((time + rng.uniform(-0.05, 0.05, len(time))) * 1e9).astype(np.int64)
    field = 3e-6 * np.multiply.outer(np.cos(angle), GAINS) + [2e-5, 0.0, 4e-5]
    field += 1e-7 * rng.standard_normal(field.shape)
    level = np.broadcast_to([0.0, 0.0, 9.81], field.shape)
    recording = ImuRecording(stamp, 0.0 * field, level, field, die, up_axis='+z')
    line = spectral_lines(prepare([recording]), SENSOR)[0]
    assert line.drift == pytest.approx(-1.4e-4, rel=0.15)


def test_what_temperature_leaves_at_low_frequencies_is_no_line() -> None:
    slow = (lagging(chamber()[1], 400.0, PERIOD) - chamber()[1]) / 10.0
    runs = runs_with(lambda: slow)
    temperature = np.concatenate([run.conditions.temperature_difference for run in runs])
    for line in spectral_lines(runs, SENSOR):
        ends = line.frequency + line.drift * np.array([temperature.min(), temperature.max()])
        assert ends.min() > LOWEST_HZ


@pytest.mark.parametrize(('hertz', 'is_line'), [(2.0 / 190.0, False), (0.13, True)])
def test_a_wave_that_swings_with_a_hair_dryer_is_no_line(hertz: float, is_line: bool) -> None:
    """Nor has it twenty periods."""
    time = np.arange(700.0)
    die = 30.0 - 8.0 * np.cos(2.0 * np.pi * time / 190.0)
    field = 3.0 * np.multiply.outer(np.cos(2.0 * np.pi * hertz * time), GAINS)
    field += np.random.default_rng(3).standard_normal(field.shape)
    level = np.broadcast_to([0.0, 0.0, 9.81], field.shape)
    stamp = np.round(time * 1e9).astype(np.int64)
    recording = ImuRecording(stamp, 0.0 * field, level, 1e-7 * field, die, up_axis='+z')
    assert bool(spectral_lines(prepare([recording]), SENSOR)) == is_line


def test_a_slow_error_in_bursts_is_no_line() -> None:
    time = np.add.outer(900.0 * np.arange(24), np.arange(40.0)).ravel()
    slow = np.cos(2.0 * np.pi * time / 9_000.0)
    stamp = np.round(time * 1e9).astype(np.int64)
    noise = 0.1 * np.random.default_rng(4).standard_normal((len(time), 3))
    at_rest = np.zeros_like(noise)
    bursts = ImuRecording(
        stamp=stamp,
        temperature=20.0 + 5.0 * np.sin(2.0 * np.pi * time / 21_000.0),
        linear_acceleration=at_rest + [0.0, 0.0, 9.8],
        angular_velocity=at_rest,
        magnetic_field=1e-7 * (np.multiply.outer(slow, GAINS) + noise),
        up_axis='+z',
    )
    assert spectral_lines(prepare([bursts]), SENSOR) == []


def test_only_a_line_that_longer_blocks_would_average_away_keeps_them_short() -> None:
    runs = runs_with(steady)
    fast, slow = SpectralLine(HERTZ, 0.0), SpectralLine(1.0 / 800.0, 0.0)
    assert in_search_blocks(runs, [fast])[0].period == runs[0].period
    longer = in_search_blocks(runs, [])[0].period
    assert longer > runs[0].period
    assert in_search_blocks(runs, [slow])[0].period == longer
    assert in_search_blocks(runs, [slow._replace(drift=1e-3)])[0].period == runs[0].period


def test_bursts_keep_their_blocks_where_there_are_few() -> None:
    """A block of a minute that holds 20 s of samples would have the noise of a minute."""
    whole = run('+z', seed=1)
    (bursts,) = prepare([whole.rows(whole.time % 600.0 < 20.0)])
    assert in_search_blocks([bursts], [])[0].period == bursts.period
