# SPDX-License-Identifier: Apache-2.0
"""Probabilities of explanations: they sum to one, and the set that is reported is the smallest."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import Settings
from thermal_comp.diagnosis.evidence.posterior import CREDIBLE_PROBABILITY, credible, probability
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.diagnosis.sensor_search import search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.noise.of_runs import determined_noise

from ...campaign import PERIOD, chamber, lagging, run


@cache
def answer(lag: float, curvature: float) -> SensorAnswer:
    """Return what explains a gyroscope with a lag and a curvature of these sizes."""
    time, temperature, *_ = chamber()
    behind = temperature - lagging(temperature, 300.0, float(time[1] - time[0]))
    error = lag * behind + curvature * ((temperature - 20.0) / 30.0) ** 2
    shaped = error[:, None] * np.array([1.0, -0.5, 0.7])
    runs = prepare([
        run(up, seed=k, error={'angular_velocity': shaped}) for k, up in enumerate(('+x', '-z'))
    ])  # fmt: skip
    base = {'gyroscope': (BiasTemperature(),)}
    return search_sensors(runs, base, determined_noise(runs, base)[0], Settings(EFFECTS))[
        'gyroscope'
    ]


FOUND = [
    pytest.param((0.0, 0.0), (), id='nothing'),
    pytest.param((2e-4, 0.0), ('thermal_lag',), id='one', marks=pytest.mark.long),
    pytest.param((2e-4, 1e-3), ('bias_temperature_curvature', 'thermal_lag'), id='two'),
]
"""Sizes that are put in, and the names that should come out."""


@pytest.mark.parametrize(('sizes', 'names'), FOUND)
def test_what_was_put_in_is_the_likeliest_explanation(sizes, names) -> None:
    said = answer(*sizes)
    found = said.explanations
    assert said.likeliest.names == names
    assert probability(found, lambda e: e.names == names) > 0.5
    assert sum(e.probability for e in found) == pytest.approx(1.0, abs=1e-9)
    assert all(e.probability >= f.probability for e, f in pairwise(found))


@pytest.mark.parametrize(('sizes', 'names'), FOUND)
def test_the_credible_set_is_the_smallest(sizes, names) -> None:
    kept = credible(answer(*sizes).explanations)
    assert names in {e.names for e in kept}
    assert sum(e.probability for e in kept) >= CREDIBLE_PROBABILITY
    assert sum(e.probability for e in kept[:-1]) < CREDIBLE_PROBABILITY


def test_a_name_leaves_room_for_a_further_effect_that_is_too_small_to_be_seen() -> None:
    said = answer(2e-4, 0.0)
    unseen = [e for e in said.explanations if set(e.names) > {'thermal_lag'}]
    assert len({e.names for e in unseen}) == len(unseen) > 5
    assert 0.001 < sum(e.probability for e in unseen) < 0.2
    assert said.likeliest.probability < 1.0 - sum(e.probability for e in unseen) + 1e-9


def said_of(
    error: np.ndarray,
    catalogue: tuple[str, ...],
    only: int | None = None,
    **logged: np.ndarray,
) -> SensorAnswer:
    """Return what explains an error (n,) in three runs, or in only one of them.

    `error` is that of a gyroscope [rad/s]; `logged`: channels beside the temperature.
    """
    shaped = error[:, None] * np.array([1.0, -0.5, 0.7])
    felt = [{'angular_velocity': shaped * (only in (None, k))} for k in range(3)]
    recordings = [run(up, seed=k, error=felt[k]) for k, up in enumerate(('+x', '+y', '+z'))]
    runs = prepare([replace(recording, **logged) for recording in recordings])
    base = {'gyroscope': (BiasTemperature(),)}
    settings = Settings({name: EFFECTS[name] for name in catalogue})
    noise = determined_noise(runs, base)[0]
    return search_sensors(runs, base, noise, settings)['gyroscope']


@pytest.mark.long
def test_what_the_equation_of_a_large_effect_lacks_is_no_second_effect() -> None:
    """A lag that grows by a fifth towards the cold, as oil and grease do."""
    time, temperature, *_ = chamber()
    step = float(time[1] - time[0])
    short, long = (temperature - lagging(temperature, s, step) for s in (280.0, 340.0))
    share = (temperature + 10.0) / 60.0
    error = 6e-4 * (share * short + (1.0 - share) * long)
    said = said_of(error, tuple(EFFECTS))
    assert said.likeliest.names in {('thermal_lag',), ('thermal_lag_two_stage',)}
    assert said.likeliest.approximate


@pytest.mark.long
def test_an_effect_like_one_whose_channel_was_not_logged_leaves_it_a_third() -> None:
    time, temperature, *_ = chamber()
    rate = 0.3 * np.gradient(temperature, time)
    two = ('temperature_rate', 'thermal_gradient')
    alone = said_of(rate, two)
    by_name = {e.names: e for e in alone.explanations}
    assert by_name['temperature_rate',].probability == pytest.approx(2.0 / 3.0, abs=0.02)
    assert by_name['unlogged',].probability == pytest.approx(1.0 / 3.0, abs=0.02)
    assert by_name['unlogged',].depends_on == 'chamber_temperature'
    assert alone.likeliest.names == ('temperature_rate',)
    # Air that leads the die by its own lag: in ramps the difference is no rate while it builds up.
    outside = temperature + 400.0 * lagging(np.gradient(temperature, time), 300.0, PERIOD)
    logged = said_of(rate, two, chamber_temperature=outside)
    by_name = {e.names: e.probability for e in logged.explanations}
    assert by_name['temperature_rate',] > 0.85
    # To a board that heats the die as fast as it follows, a difference would be a rate.
    assert by_name['thermal_gradient',] > 0.95 - by_name['temperature_rate',]


def test_a_step_is_found_beneath_the_levels_of_the_cycles() -> None:
    """Between two times that are tried, where it is no larger than the levels' own steps."""
    time, _, _, cycle = chamber()
    levels = np.array([0.0, 8e-4, -6e-4, 9e-4, -7e-4])[np.minimum(cycle, 4)]
    said = said_of(levels + 5e-4 * (time >= 16_170.0), ('turn_on_bias', 'bias_step'), only=1)
    assert said.likeliest.names == ('bias_step', 'turn_on_bias')
    step = next(c.form.effect for c in said.likeliest.components if c.name == 'bias_step')
    assert step.step_time[0] == pytest.approx(16_170.0, abs=30.0)


def test_what_repeats_with_the_cycle_may_be_a_law_of_history_or_a_machine() -> None:
    """Ice that grows and breaks off: neither a curve nor a branch, and no channel was logged."""
    time, _, _, cycle = chamber()
    since = time - np.array([time[cycle == k][0] for k in cycle])
    burst = 8e-4 * np.exp(-0.5 * ((since - 2900.0) / 150.0) ** 2) * (cycle > 0)
    said = said_of(burst, ('thermal_lag', 'bias_temperature_curvature')).explanations
    by_name = {e.names: e.probability for e in said}
    assert by_name['unlogged',] > by_name['not_in_catalogue',] > 0.05


@pytest.mark.long
def test_a_course_over_time_may_be_a_channel_that_was_not_logged() -> None:
    time = chamber()[0]
    waves = 4e-4 * np.sin(2.0 * np.pi * time / 9000.0 + (time / 2e4) ** 2)
    unknown = said_of(waves, ('thermal_lag', 'warm_up')).explanations
    by_name = {e.names: e.probability for e in unknown[:2]}
    assert set(by_name) == {('not_in_catalogue',), ('unlogged',)}
    assert min(by_name.values()) > 0.2
    every = ('heater', 'compressor', 'supply_voltage', 'humidity')
    constant = {name: np.zeros(len(time)) for name in every}
    logged = said_of(
        waves, ('thermal_lag', 'warm_up'), **constant, vibration=np.zeros((len(time), 3))
    )
    assert logged.likeliest.names == ('not_in_catalogue',)
    assert probability(logged.explanations, lambda e: e.names == ('unlogged',)) < 0.05


@pytest.mark.long
def test_humidity_that_was_not_logged_is_said_to_be_lacking() -> None:
    """Closed air of dew point 5 °C, taken up in 40 minutes: its log would have told."""
    time, temperature, *_ = chamber()
    dew, air = (17.62 * t / (243.12 + t) for t in (np.array(5.0), temperature))
    humidity = np.minimum(np.exp(dew - air), 1.0)
    taken_up = humidity - lagging(humidity, 2400.0, float(time[1] - time[0]))
    said = said_of(1e-3 * taken_up, tuple(EFFECTS))
    assert said.kind == 'unlogged'
    assert said.likeliest.depends_on == 'humidity'
    assert said.probability_of('unlogged') > 0.9
    assert said.named == ()
    assert not any(effect.guessed_channel for effect in said.closest)
    logged = said_of(1e-3 * taken_up, tuple(EFFECTS), humidity=humidity)
    assert 'humidity' in logged.likeliest.names
    assert logged.kind == 'named'


@pytest.mark.parametrize('settling', [0.0, pytest.param(60.0, marks=pytest.mark.long)])
def test_several_steps_may_be_one_supply_that_is_switched(settling: float) -> None:
    """And so may steps that are none in truth: what is switched settles."""
    time = chamber()[0]
    switched = 6e-4 * ((time > 14_000.0) & (time < 29_000.0))
    if settling:
        switched = lagging(switched, settling, float(time[1] - time[0]))
    said = said_of(switched, tuple(EFFECTS), only=1)
    assert said.kind == 'unlogged'


def test_steps_of_what_is_switched_are_no_law_of_a_channel_that_was() -> None:
    """Four steps, one of which a fan happens to share."""
    time = chamber()[0]
    on = ((time > 8000.0) & (time < 14_000.0)) | ((time > 29_000.0) & (time < 38_000.0))
    said = said_of(6e-4 * on, tuple(EFFECTS), fan=(time > 29_000.0).astype(float))
    assert said.kind == 'unlogged'


@pytest.mark.long
def test_an_effect_beside_a_supply_that_was_not_logged_keeps_its_name() -> None:
    time, temperature, *_ = chamber()
    switched = 6e-4 * ((time > 14_000.0) & (time < 29_000.0))
    behind = temperature - lagging(temperature, 300.0, float(time[1] - time[0]))
    said = said_of(switched + 2e-4 * behind, tuple(EFFECTS))
    assert said.kind == 'unlogged'
    assert said.likeliest.names == ('thermal_lag', 'unlogged')
    assert [effect.name for effect in said.named] == ['thermal_lag']
    assert said.probability_of('thermal_lag') > 0.85


@pytest.mark.long
def test_a_bias_that_jumps_between_levels_is_not_called_a_switched_channel_alone() -> None:
    """Random telegraph noise: what is switched and was not logged makes the same steps."""
    time = chamber()[0]
    jumps = np.cumsum(np.random.default_rng(4).exponential(5000.0, 40))
    level = 6e-4 * (np.searchsorted(jumps, time) % 2)
    said = said_of(level, tuple(EFFECTS), only=1)
    kept = {e.names for e in credible(said.explanations)}
    assert kept >= {('not_in_catalogue',), ('unlogged',)}


def test_twins_whose_courses_are_the_same_to_some_per_cent_are_both_said() -> None:
    """Air that leads the die by its lag, through a thermometer that follows in half a minute."""
    time, temperature, *_ = chamber()
    rate = np.gradient(temperature, time)
    outside = lagging(temperature + 200.0 * rate, 30.0, PERIOD)
    said = said_of(
        0.3 * rate, ('temperature_rate', 'thermal_gradient'), chamber_temperature=outside
    )
    by_name = {e.names: e.probability for e in said.explanations}
    assert min(by_name['temperature_rate',], by_name['thermal_gradient',]) > 0.05
    assert by_name['temperature_rate',] + by_name['thermal_gradient',] > 0.9
    assert by_name['temperature_rate',] > by_name['thermal_gradient',]


def test_a_rate_keeps_its_name_beside_a_guess_of_what_was_not_logged() -> None:
    """The guess bends to what the rate leaves after power-on, a few per cent of it."""
    time, temperature, *_ = chamber()
    rate = np.gradient(temperature, time)
    transient = 2e-3 * np.exp(-(time - time[0]) / 150.0)
    said = said_of(2.0 * (rate + transient), ('temperature_rate', 'thermal_gradient'))
    by_name = {e.names: e.probability for e in said.explanations}
    assert by_name['temperature_rate',] == pytest.approx(2.0 / 3.0, abs=0.05)
    assert by_name['unlogged',] == pytest.approx(1.0 / 3.0, abs=0.05)


def test_a_channel_that_is_read_with_noise_still_names_its_effect() -> None:
    time = chamber()[0]
    shaking = np.random.default_rng(3)
    load = 1.0 + 0.3 * np.sin(2.0 * np.pi * time / 700.0)
    variance = np.multiply.outer(4e-4 * load * (time % 1500.0 < 600.0), [0.8, 1.0, 1.2])
    read = variance * shaking.chisquare(200, size=variance.shape) / 200.0
    error = variance @ np.diag([40.0, -60.0, 30.0])
    runs = prepare([
        replace(run(up, seed=k, error={'linear_acceleration': error}), vibration=read)
        for k, up in enumerate(('+x', '+y', '+z'))
    ])  # fmt: skip
    base = {'accelerometer': (BiasTemperature(),)}
    noise = determined_noise(runs, base)[0]
    said = search_sensors(runs, base, noise, Settings(EFFECTS))['accelerometer']
    assert said.likeliest.names == ('vibration_rectification',)
    assert said.likeliest.probability > 0.9


@pytest.mark.long
def test_what_a_compressor_does_without_turning_came_through_the_supply() -> None:
    time = chamber()[0]
    running = (np.sin(time / 240.0 + (time / 1e4) ** 2) > 0.2).astype(float)
    courses = {False: 3e-7 * lagging(running, 40.0, PERIOD), True: 3e-7 * running}
    base = {'magnetometer': (BiasTemperature(),)}
    said = {}
    for turned in (False, True):
        runs = prepare([
            replace(
                run(up, seed=k, error={'magnetic_field': np.outer(courses[turned], gains)}),
                compressor=running,
            )
            for k, (up, gains) in enumerate(zip(('+x', '+y', '+z'), _seen(turned), strict=True))
        ])  # fmt: skip
        noise = determined_noise(runs, base)[0]
        said[turned] = search_sensors(runs, base, noise, Settings(EFFECTS))['magnetometer']
    assert (said[False].kind, said[False].likeliest.depends_on) == ('unlogged', 'supply')
    assert said[True].likeliest.names == ('compressor_hard_iron',)


def _seen(turned: bool) -> list[np.ndarray]:
    """Return per run the direction in the sensor's frame, of the chamber or of the sensor."""
    direction = np.array([1.0, -0.7, 0.8])
    return [np.roll(direction, axis + 1) if turned else direction for axis in range(3)]
