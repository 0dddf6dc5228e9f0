# SPDX-License-Identifier: Apache-2.0
"""The C99 form of models, compiled with sanitizers and run against the Python compensator."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from ament_index_python import get_package_share_directory
from catkin_pkg.package import parse_package
from thermal_comp.compensation.recording import compensate
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects import EFFECTS, Effect
from thermal_comp.effects.c_form import CColumns
from thermal_comp.effects.contract import example_conditions
from thermal_comp.effects.humidity import Humidity
from thermal_comp.effects.thermal_gradient import ESTIMATED_FROM_DIE, ThermalGradient
from thermal_comp.export.c99 import c99_of
from thermal_comp.export.single_precision import LARGEST_ROUNDING_SHARE, single_precision_shares
from thermal_comp.export.vectors import example_course, recorded_course, vectors_text
from thermal_comp.model.values import ModelError, NoiseModel, SensorModel, ThermalModel

from imu_recording import read_bag

FIRMWARE = Path(__file__).parents[3] / 'firmware'
DEVICE_EFFECTS = sorted(name for name, effect in EFFECTS.items() if effect.kind == 'device')


@pytest.fixture
def compiler() -> None:
    """A C compiler; without one a test fails rather than passing unseen."""
    missing = [name for name in ('cc', 'make', 'cmake') if not shutil.which(name)]
    if missing:
        pytest.fail(f'no {", ".join(missing)}: apt install build-essential cmake', pytrace=False)


def model_of(effects: Sequence[Effect], seed: int = 0) -> ThermalModel:
    """A model of effects whose coefficients are drawn so that each adds about as much."""
    rng = np.random.default_rng(seed)
    sensors = {}
    for sensor in ('accelerometer', 'gyroscope', 'magnetometer'):
        terms = [effect for effect in effects if sensor in effect.sensors]
        coefficients = []
        for effect in terms:
            columns, _ = effect.columns(example_conditions(sensor=sensor))
            size = np.abs(columns).reshape(-1, columns.shape[-1]).max(axis=0)
            shape = (len(size), 3) if columns.ndim == 2 else (len(size),)
            drawn = rng.normal(size=shape)
            coefficients.append((drawn.T / size).T)
        count = sum(c.size for c in coefficients)
        sensors[sensor] = SensorModel(
            effects=tuple(terms),
            coefficients=tuple(coefficients),
            covariance=np.zeros((count, count)),
            noise=NoiseModel(np.ones(3), np.array([100.0]), np.zeros((1, 3))),
            temperature_range=(-5.0, 45.0),
        )
    return ThermalModel('dut1', sensors, reference_temperature=22.5)


def with_coefficients(
    effects: Sequence[Effect], coefficients: Sequence[Sequence[Sequence[float]]]
) -> ThermalModel:
    """A model of effects whose coefficients are given, the same of every sensor."""
    model = model_of(effects)
    given = tuple(np.array(rows) for rows in coefficients)
    parts = {s: replace(part, coefficients=given) for s, part in model.sensors.items()}
    return replace(model, sensors=parts)


def write_c(folder: Path, model: ThermalModel) -> Mapping[str, int]:
    """Write the C form; return the channels of a sample."""
    exported = c99_of(model)
    folder.mkdir(exist_ok=True)
    for name, text in exported.files.items():
        (folder / name).write_text(text, 'utf-8')
    return exported.channels


def off_by(folder: Path, model: ThermalModel, courses: Sequence[Conditions]) -> list[float]:
    """Write, compile and run the C form; return what `make` says the errors are off by."""
    channels = write_c(folder, model)
    vectors = vectors_text(model, channels, courses)
    (folder / 'imu_thermal_vectors.txt').write_text(vectors)
    command = ['make', '-s', '-C', FIRMWARE, 'thermal', f'THERMAL={folder}', f'BUILD={folder}/b']
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return [float(x) for x in re.findall(r'off by (\S+) of', done.stdout)]


@pytest.mark.usefixtures('compiler')
@pytest.mark.parametrize(
    'effect',
    [*(EFFECTS[name]() for name in DEVICE_EFFECTS), Humidity(by_diffusion=1.0)],
    ids=[*DEVICE_EFFECTS, 'humidity_by_diffusion'],
)
def test_effect_in_c_is_the_effect(effect: Effect, tmp_path: Path) -> None:
    model = model_of([effect])
    off = off_by(tmp_path, model, [example_course(model)])
    assert len(off) == 2 * sum(bool(part.effects) for part in model.sensors.values())


@pytest.mark.usefixtures('compiler')
def test_a_gradient_in_c_asks_for_the_thermometer_it_was_fitted_with(tmp_path: Path) -> None:
    for form, channels in [(1.0, ['device_temperature']), (ESTIMATED_FROM_DIE, [])]:
        model = model_of([ThermalGradient(outside=form)])
        assert [*write_c(tmp_path, model)] == channels
        off_by(tmp_path, model, [example_course(model)])


@pytest.mark.long
@pytest.mark.usefixtures('compiler')
def test_all_effects_at_once_share_what_they_follow(tmp_path: Path) -> None:
    model = model_of([EFFECTS[name]() for name in DEVICE_EFFECTS])
    off_by(tmp_path, model, [example_course(model), example_course(model)])
    # 1 lag of thermal_lag, 1 of the two stages, 2 of the rate, 10 of the empirical term, humidity:
    # once each, however many sensors follow them; the second stage is kept as a difference.
    assert 'imu_thermal_lag lag[15];' in (tmp_path / 'imu_thermal.h').read_text()


@pytest.mark.long
@pytest.mark.usefixtures('compiler')
def test_bundled_bags_are_compensated_alike(bags: Path, tmp_path: Path) -> None:
    names = ['bias_temperature', 'bias_temperature_curvature', 'thermal_lag', 'thermal_hysteresis']
    effects = [EFFECTS[name]() for name in [*names, 'temperature_rate', 'warm_up']]
    model = model_of(effects)
    paths = [bags / f'dut1_{axis}' for axis in 'xyz'] + [bags / 'hidden_effect_x']
    recordings = [read_bag(path) for path in paths]
    courses = [recorded_course(model, recording) for recording in recordings]
    off = off_by(tmp_path, model, courses)
    assert max(off[:3]) < 1e-6
    assert max(off[3:]) < 1e-5
    # What the vectors hold is what `compensate` subtracts.
    changed = compensate(replace(recordings[0], device=''), model).linear_acceleration
    lines = (tmp_path / 'imu_thermal_vectors.txt').read_text().splitlines()
    first, last = (np.array(lines[k].split(), float) for k in (1, len(courses[0])))
    subtracted = recordings[0].linear_acceleration - changed
    np.testing.assert_allclose(first[14:17], subtracted[0], atol=1e-12)
    np.testing.assert_allclose(last[14:17], subtracted[-1], atol=1e-12)


@pytest.mark.long
@pytest.mark.usefixtures('compiler')
def test_a_slow_lag_at_a_high_rate_holds_in_single_precision(tmp_path: Path) -> None:
    """An hour's lag at 952 Hz: a step changes it by less than single precision resolves."""
    n = 200_000
    time = np.arange(n) / 952.0
    still = np.zeros((n, 3))
    swing = 20.0 + 15.0 * np.sin(time / 40.0)
    measured = np.float64(np.float32(np.round(swing * 16.0) / 16.0))  # a thermometer's steps
    effect = EFFECTS['thermal_lag'](time_constant=3600.0)
    model = model_of([effect])
    course = Conditions(time, measured, still, still, still, reference_temperature=22.5)
    assert max(off_by(tmp_path, model, [course])[3:]) < 1e-5


@pytest.mark.usefixtures('compiler')
@pytest.mark.parametrize('slow', [1000.0, 431.1, 429.9])
def test_two_lags_that_nearly_cancel_hold_in_single_precision(slow: float, tmp_path: Path) -> None:
    """A fit that finds no second lag lets the two meet, with large coefficients against it."""
    effect = EFFECTS['thermal_lag_two_stage'](430.0, slow)
    model = with_coefficients([effect], [[[1.0] * 3, [-1.0] * 3]])
    off = off_by(tmp_path, model, [example_course(model)])
    assert len(off) == 6
    assert max(off[:3]) < 1e-9
    assert max(off[3:]) < 1e-6


@pytest.mark.usefixtures('compiler')
def test_what_single_precision_is_off_by_is_foreseen(tmp_path: Path) -> None:
    """Two effects of nearly the same lag: no form of either one can help."""
    effects = [EFFECTS['thermal_lag'](300.0), EFFECTS['thermal_lag_two_stage'](300.5, 900.0)]
    model = with_coefficients(effects, [[[1.0] * 3], [[-1.0] * 3, [0.0] * 3]])
    vectors = vectors_text(model, write_c(tmp_path, model), [example_course(model)])
    (tmp_path / 'imu_thermal_vectors.txt').write_text(vectors)
    command = ['make', '-s', '-C', FIRMWARE, 'thermal', f'THERMAL={tmp_path}']
    done = subprocess.run(
        [*command, f'BUILD={tmp_path}/b'], capture_output=True, text=True, check=False
    )
    assert done.returncode
    single = [float(x) for x in re.findall(r'off by (\S+) of.*too much', done.stdout)]
    foreseen = single_precision_shares(model, [example_course(model)])
    assert len(single) == len(foreseen) == 3
    for share in foreseen.values():
        assert max(single) / 3.0 < share < 6.0 * min(single)
    usual = model_of([EFFECTS[name]() for name in DEVICE_EFFECTS])
    assert (
        max(single_precision_shares(usual, [example_course(usual)]).values())
        < LARGEST_ROUNDING_SHARE
    )


@pytest.mark.usefixtures('compiler')
def test_the_package_config_is_found(tmp_path: Path) -> None:
    write_c(tmp_path / 'thermal', model_of([EFFECTS['thermal_lag']()]))
    user = tmp_path / 'user'
    user.mkdir()
    (user / 'CMakeLists.txt').write_text(
        'cmake_minimum_required(VERSION 3.16)\nproject(user LANGUAGES CXX)\n'
        'find_package(imu_thermal REQUIRED)\nadd_executable(user user.cpp)\n'
        'target_link_libraries(user imu_thermal::imu_thermal)\n'
    )
    (user / 'user.cpp').write_text(
        '#include <imu_thermal.h>\nint main() {\n  imu_thermal_state state;\n'
        '  imu_thermal_start(&state);\n  return (int)state.started;\n}\n'
    )
    prefix = tmp_path / 'prefix'
    for source in (tmp_path / 'thermal', user):
        build = tmp_path / f'build_{source.name}'
        make = ['cmake', '-S', source, '-B', build, f'-DCMAKE_PREFIX_PATH={prefix}']
        subprocess.run(
            [*make, f'-DCMAKE_INSTALL_PREFIX={prefix}'], check=True, capture_output=True
        )
        install = ['--target', 'install'] if source != user else []
        subprocess.run(['cmake', '--build', build, *install], check=True, capture_output=True)
    subprocess.run([tmp_path / 'build_user' / 'user'], check=True)


@pytest.mark.usefixtures('compiler')
def test_ros_finds_the_package_where_it_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_c(tmp_path / 'thermal', model_of([EFFECTS['thermal_lag']()]))
    prefix, build = tmp_path / 'prefix', tmp_path / 'build'
    make = ['cmake', '-S', tmp_path / 'thermal', '-B', build, f'-DCMAKE_INSTALL_PREFIX={prefix}']
    subprocess.run(make, check=True, capture_output=True)
    install = ['cmake', '--build', build, '--target', 'install']
    subprocess.run(install, check=True, capture_output=True)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    share = Path(get_package_share_directory('imu_thermal'))
    package = parse_package(share)
    assert package.name == 'imu_thermal'
    assert package.get_build_type() == 'cmake'


@dataclass(frozen=True)
class Foreign(Effect):
    """An effect of a user without a C form."""

    name = 'foreign'
    sensors = ('gyroscope',)
    equation = 'error = a · x'
    coefficient_units = ('{unit}/K',)

    def columns(self, conditions, state=None):
        return conditions.temperature_difference[:, None], None


def test_an_effect_without_a_c_form_is_refused_by_name() -> None:
    class PerRun(Foreign):
        per_run = True

        def c_columns(self, c):
            return CColumns([c.temperature_difference])

    for effect in (Foreign(), PerRun()):
        with pytest.raises(ModelError, match=r'gyroscope: foreign.*c_columns'):
            c99_of(model_of([effect, EFFECTS['bias_temperature']()]))


@pytest.mark.usefixtures('compiler')
def test_a_users_effect_brings_its_c_form(tmp_path: Path) -> None:
    class Own(Foreign):
        """The activity dip of CONTRIBUTING.md."""

        centre = 30.0

        def columns(self, conditions, state=None):
            return np.exp(-(((conditions.temperature - self.centre) / 3.0) ** 2))[:, None], None

        def c_columns(self, c):
            x = c.let(f'({c.temperature} - {c.number(self.centre)}) / {c.number(3.0)}')
            return CColumns([c.exp(f'-{x} * {x}')])

    off_by(tmp_path, model_of([Own()]), [example_course(model_of([Own()]))])


@pytest.mark.usefixtures('compiler')
def test_sums_within_a_users_effect_are_kept_together(tmp_path: Path) -> None:
    class Shared(Foreign):
        """Coefficients shared by the axes, written without parentheses; waits for a channel."""

        channels = ('supply_voltage',)

        def columns(self, conditions, state=None):
            x = conditions.temperature_difference
            return np.stack([x - 3.0, 2.0 - x, 0.0 * x], axis=1)[:, :, None], None

        def c_columns(self, c):
            x = c.temperature_difference
            return CColumns([(f'{x} - {c.number(3.0)}', f'{c.number(2.0)} - {x}', '')])

    off_by(tmp_path, model_of([Shared()]), [example_course(model_of([Shared()]))])


def test_a_bending_effect_with_a_history_is_refused() -> None:
    class Bends(Foreign):
        bends = True

        def c_columns(self, c):
            return CColumns([c.behind(c.temperature, 10.0)])

    with pytest.raises(Exception, match='foreign: bends'):
        c99_of(model_of([Bends()]))


def test_a_model_without_field_effects_is_refused() -> None:
    with pytest.raises(ModelError, match='nothing to export'):
        c99_of(model_of([]))


def test_a_comment_cannot_be_left() -> None:
    model = replace(model_of([EFFECTS['bias_temperature']()]), device='a */ #error\n"b')
    assert 'a * / #error "b' in c99_of(model).files['imu_thermal.h']
