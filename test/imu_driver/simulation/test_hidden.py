# SPDX-License-Identifier: Apache-2.0
"""Hidden effects: exactly as large as asked for, and each with the mark of its physics."""

from dataclasses import replace

import numpy as np
import pytest
from imu_driver.simulation.devices import MEAN_STD, draw_device
from imu_driver.simulation.effects import bias_in_time, chamber, exposure, heat, uncatalogued
from imu_driver.simulation.effects.exposure import ice_mass
from imu_driver.simulation.effects.heat import bouc_wen, follow, sheltered
from imu_driver.simulation.effects.hidden_effect import (
    HiddenEffect,
    add_hidden_effect,
    magnitude,
)
from imu_driver.simulation.environment import Environment, constant_environment
from imu_driver.simulation.hidden import (
    FAULTS,
    HIDDEN_EFFECTS,
    HIDEABLE,
    UNLOGGED_EFFECTS,
    hide_anything,
    random_name,
)
from imu_driver.simulation.run import DeviceRun, prepare_run
from imu_driver.simulation.thermal import DIE

PERIOD = 4.0
CYCLE = (900, 1800, 1800, 1800, 900, 1800)
LEVELS = (20, -10, -10, 50, 50, 20, 20)


def plan(cycles: int = 2, stretch: float = 1.0) -> Environment:
    """The paper's cycles, chamber states chosen so that no two tracks go together."""
    corners, levels = [0.0, 1200.0], [20.0, 20.0]
    for _ in range(cycles):
        corners += list(corners[-1] + stretch * np.cumsum(CYCLE))
        levels += list(LEVELS[1:])
    time = np.arange(0.0, corners[-1], PERIOD)
    air = np.interp(time, corners, levels)
    begin = corners[1]
    cycle = np.where(time < begin, 0, (time - begin) // (stretch * sum(CYCLE)) + 1)
    return Environment(
        time,
        air,
        setpoint=air,
        cycle=cycle.astype(np.int64),
        phase=np.zeros(len(time), int),
        heater=(time // 40 % 3 == 0).astype(float),
        compressor=(time // 700 % 2).astype(float),
        fan=np.ones(len(time)),
        humidity=0.5 + 0.3 * np.sin(time / 2500.0),
    )


@pytest.fixture(scope='module')
def runs() -> list[DeviceRun]:
    device = draw_device(2)
    return [
        prepare_run(device, plan(), seed=(3, k), orientation=axis)
        for k, axis in enumerate(('+x', '+y', '+z'))
    ]


def hidden(runs: list[DeviceRun], name: str, sensor: str, size: float = 2.0) -> list[np.ndarray]:
    changed, _ = add_hidden_effect(
        runs, HIDDEN_EFFECTS[name], sensor=sensor, magnitude_wanted=size, seed=5
    )
    return [run.hidden[sensor.split('+', maxsplit=1)[0]] for run in changed]


CASES = [(name, sensor) for name, law in HIDDEN_EFFECTS.items() for sensor in law.sensors]


@pytest.mark.parametrize(('name', 'sensor'), CASES)
def test_magnitude_is_as_asked_for(runs: list[DeviceRun], name: str, sensor: str) -> None:
    changed, truth = add_hidden_effect(
        runs, HIDDEN_EFFECTS[name], sensor=sensor, magnitude_wanted=0.7, seed=5
    )
    assert magnitude(changed, [run.hidden for run in changed]) == pytest.approx(0.7, rel=1e-9)
    mounting = HIDDEN_EFFECTS[name].mounting
    placed = [mounting(run) for run in runs] if mounting else runs
    for before, after in zip(placed, changed, strict=True):
        for part, values in before.errors.items():
            grown = after.errors[part] - values
            expected = after.hidden.get(part, np.zeros_like(values))
            np.testing.assert_allclose(grown, expected, atol=1e-9 * MEAN_STD[part])
    assert truth.name == (None if truth.depends_on else name)


def test_magnitude_ignores_levels_and_a_line_in_temperature(runs: list[DeviceRun]) -> None:
    shape = HIDDEN_EFFECTS['mode_crossing'].shape(runs, 'gyroscope', np.random.default_rng(1))
    plus = [
        {'gyroscope': wave['gyroscope'] + k + 3.0 * run.temperature_difference[:, None]}
        for k, (run, wave) in enumerate(zip(runs, shape.errors, strict=True))
    ]
    assert magnitude(runs, plus) == pytest.approx(magnitude(runs, shape.errors), rel=1e-6)


def test_a_device_without_a_hidden_effect_is_linear(runs: list[DeviceRun]) -> None:
    device = runs[0].device
    silent = replace(
        device, **{name: replace(device.sensor(name), bias_instability=0.0) for name in MEAN_STD}
    )
    still = [
        prepare_run(silent, run.environment, seed=run.seed, orientation=run.orientation)
        for run in runs
    ]
    for name in MEAN_STD:  # a twentieth of what the best detector sees
        assert magnitude(still, [{name: run.errors[name]} for run in still]) < 0.05


def test_lag_opens_in_ramps_and_closes_in_dwells(runs: list[DeviceRun]) -> None:
    wave = hidden(runs, 'thermal_lag', 'gyroscope')[0][:, 0]
    time = runs[0].environment.time
    ramp = np.abs(wave[np.searchsorted(time, 1200 + 850)])
    late = np.abs(wave[np.searchsorted(time, 1200 + 900 + 1790)])
    assert late < 0.15 * ramp


def test_a_node_follows_with_its_time_constant() -> None:
    step = np.concatenate([np.full(10, 20.0), np.full(1000, 21.0)])
    node = follow(step, step, 200.0, 0.0, 1.0)
    assert np.argmax(node[10:] > 20.632) == pytest.approx(200, abs=4)


def test_rate_vanishes_in_dwells_and_changes_sign_with_the_ramp(runs: list[DeviceRun]) -> None:
    wave = hidden(runs, 'temperature_rate', 'gyroscope')[0][:, 1]
    time = runs[0].environment.time
    down, dwell, up = (wave[np.searchsorted(time, 1200 + t)] for t in (800, 2600, 4000))
    assert down == pytest.approx(-up, rel=0.03)
    assert abs(dwell) < 0.02 * abs(up)


def test_gradient_lasts_in_dwells_where_the_rate_has_faded(runs: list[DeviceRun]) -> None:
    run = sheltered(runs[0])
    wave = np.abs(hidden(runs, 'thermal_gradient', 'gyroscope')[0][:, 0])
    rate = np.abs(np.gradient(run.nodes[:, DIE]))
    dwell = np.searchsorted(run.environment.time, 1200 + 900 + 600)
    assert wave[dwell] / wave.max() > 1.5 * rate[dwell] / rate.max()


def test_gradient_is_not_the_rate(runs: list[DeviceRun]) -> None:
    changed, _ = add_hidden_effect(
        runs, HIDDEN_EFFECTS['thermal_gradient'], sensor='gyroscope', magnitude_wanted=2.0, seed=5
    )
    run = changed[0]
    wave = run.hidden['gyroscope'][:, 0]
    rate = np.gradient(run.nodes[:, DIE], PERIOD)
    assert abs(np.corrcoef(wave, rate)[0, 1]) < 0.97
    outside = run.environment.free_stream - run.nodes[:, DIE]
    assert abs(np.corrcoef(wave, outside)[0, 1]) > 0.99


def test_a_sheltered_device_keeps_all_errors_but_those_of_its_temperature(
    runs: list[DeviceRun],
) -> None:
    run = sheltered(runs[0])
    assert sheltered(run) is run
    assert np.abs(run.nodes[:, DIE] - runs[0].nodes[:, DIE]).max() > 2.0
    slope = runs[0].device.gyroscope.slope
    moved = run.errors['gyroscope'] - runs[0].errors['gyroscope']
    warmer = run.nodes[:, DIE] - runs[0].nodes[:, DIE]
    np.testing.assert_allclose(moved, np.multiply.outer(warmer, slope), rtol=0.02, atol=1e-9)


def test_hysteresis_does_not_depend_on_speed() -> None:
    fast = np.concatenate([np.linspace(20, -10, 300), np.linspace(-10, 50, 600)])
    slow = np.repeat(fast, 5)
    np.testing.assert_allclose(
        bouc_wen(slow, 10.0, 1.4)[4::5], bouc_wen(fast, 10.0, 1.4), rtol=0.02, atol=0.05
    )


def test_hysteresis_keeps_its_branch_in_dwells(runs: list[DeviceRun]) -> None:
    wave = hidden(runs, 'thermal_hysteresis', 'accelerometer')[0][:, 0]
    die = runs[0].nodes[:, DIE]
    at = np.flatnonzero(np.diff(np.sign(die - 10.0)))
    cooling, heating = wave[at[0]], wave[at[1]]
    assert abs(cooling - heating) > 0.5 * np.ptp(wave)


def test_ice_grows_only_below_zero_and_melts_above() -> None:
    surface = np.concatenate([np.full(500, 5.0), np.full(900, -5.0), np.full(900, 5.0)])
    ice = ice_mass(surface, 600.0, 300.0, 1.0)
    assert np.all(ice[:500] == 0.0)
    assert np.all(np.diff(ice[501:1400]) > 0.0)
    assert np.all(np.diff(ice[1401:]) < 0.0)
    assert ice[1399] == pytest.approx(1.0 - np.exp(-900.0 / 600.0), rel=0.01)
    assert ice[-1] == pytest.approx(ice[1399] * np.exp(-3.0), rel=0.02)


@pytest.mark.parametrize('name', ['heater_hard_iron', 'compressor_hard_iron', 'fixture_hard_iron'])
def test_chamber_fields_keep_their_direction_in_the_chamber(
    runs: list[DeviceRun], name: str
) -> None:
    waves = hidden(runs, name, 'magnetometer')
    directions = []
    for run, wave in zip(runs, waves, strict=True):
        moving = wave - wave.mean(axis=0)
        _, _, axes = np.linalg.svd(moving, full_matrices=False)
        directions.append(np.abs(run.matrix.T @ axes[0]))
    np.testing.assert_allclose(directions[1], directions[0], atol=1e-6)
    np.testing.assert_allclose(directions[2], directions[0], atol=1e-6)


def test_the_compressors_field_is_there_while_it_runs(runs: list[DeviceRun]) -> None:
    wave = hidden(runs, 'compressor_hard_iron', 'magnetometer')[1]
    off = runs[1].environment.column('compressor') == 0.0
    np.testing.assert_array_equal(wave[off], 0.0)
    assert np.abs(wave[~off]).min(axis=0).max() > 0.0


def test_a_tilt_turns_gravity_and_field_by_one_rotation(runs: list[DeviceRun]) -> None:
    changed, _ = add_hidden_effect(
        runs,
        HIDDEN_EFFECTS['fixture_tilt'],
        sensor='accelerometer+magnetometer',
        magnitude_wanted=3.0,
        seed=5,
    )
    # δ = θ × u for both: (force, field) before and after keep lengths and the angle between.
    for run in changed:
        force, field = (run.true_input(s) for s in ('accelerometer', 'magnetometer'))
        force_2 = force + run.hidden['accelerometer'][-1]
        field_2 = field + run.hidden['magnetometer'][-1]
        factor = np.linalg.norm(run.hidden['accelerometer'][-1]) / np.linalg.norm(force)
        assert 0.0 < factor < 0.02
        assert force_2 @ field_2 == pytest.approx(force @ field, rel=1e-3)
        assert force_2 @ force_2 == pytest.approx(force @ force, rel=1e-4)


def test_turn_on_bias_jumps_only_between_cycles(runs: list[DeviceRun]) -> None:
    wave = hidden(runs, 'turn_on_bias', 'gyroscope')[2]
    jumps = np.flatnonzero(np.any(np.diff(wave, axis=0) != 0.0, axis=1))
    cycle = runs[2].environment.cycle
    assert cycle is not None
    np.testing.assert_array_equal(cycle[jumps + 1] - cycle[jumps], 1)
    assert len(jumps) == cycle.max() - 1


def test_a_step_is_in_one_run_only(runs: list[DeviceRun]) -> None:
    sizes = [np.ptp(wave) for wave in hidden(runs, 'bias_step', 'accelerometer')]
    assert sum(size > 0.0 for size in sizes) == 1


def test_warm_up_is_the_same_after_every_power_on(runs: list[DeviceRun]) -> None:
    first, second, third = hidden(runs, 'warm_up', 'magnetometer')
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(first, third)
    assert np.abs(first[-1]).max() < 0.01 * np.abs(first[0]).max()


def test_what_the_profile_does_not_excite_is_refused() -> None:
    still = prepare_run(draw_device(1), constant_environment(20.0, 4000.0), seed=1)
    with pytest.raises(ValueError, match='icing does nothing in these runs'):
        add_hidden_effect(
            [still], HIDDEN_EFFECTS['icing'], sensor='gyroscope', magnitude_wanted=1.0, seed=1
        )


def test_what_is_a_line_in_a_single_pose_is_refused(runs: list[DeviceRun]) -> None:
    with pytest.raises(ValueError, match=r'fixture_tilt cannot be seen .* more orientations'):
        hide_anything(runs[:1], 'fixture_tilt', magnitude=2.0, seed=1)


def test_a_wrong_sensor_is_refused_with_the_right_ones(runs: list[DeviceRun]) -> None:
    with pytest.raises(ValueError, match='hides in magnetometer'):
        hide_anything(runs, 'heater_hard_iron', magnitude=1.0, seed=1, sensor='gyroscope')
    with pytest.raises(ValueError, match="the simulator cannot hide 'tea'"):
        hide_anything(runs, 'tea', magnitude=1.0, seed=1)


def test_every_hidden_effect_is_listed() -> None:
    written = {
        value.name: value
        for module in (bias_in_time, chamber, exposure, heat, uncatalogued)
        for value in vars(module).values()
        if isinstance(value, HiddenEffect)
    }
    assert written == HIDDEN_EFFECTS
    logged = [effect for effect in written.values() if effect.logged_as]
    assert {effect.name for effect in UNLOGGED_EFFECTS.values()} == {
        effect.name for effect in logged
    }


def test_random_hides_every_kind_in_the_end() -> None:
    drawn = {random_name(seed) for seed in range(600)}
    assert drawn <= set(HIDEABLE)
    assert drawn >= {'nothing', *FAULTS, 'mode_crossing', 'thermal_lag'}
    assert drawn & set(UNLOGGED_EFFECTS)
