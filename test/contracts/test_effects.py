# SPDX-License-Identifier: Apache-2.0
"""What every effect of the catalogue promises, and that nobody else knows an effect by name."""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from thermal_comp.data.conditions import CHANNELS
from thermal_comp.effects import EFFECTS, Candidate
from thermal_comp.effects.contract import check_effect, example_conditions
from thermal_comp.effects.explanation import explain_all
from thermal_comp.effects.operators import follow
from thermal_comp.effects.thermal_hysteresis import ThermalHysteresis
from thermal_comp.effects.thermal_lag import ThermalLag

ROOT = Path(__file__).parents[2]
NAMES = sorted(EFFECTS)
OWNERS = (
    'src/thermal_comp/thermal_comp/effects',
    'src/imu_driver/imu_driver/simulation',  # a physics of its own, which hides effects by name
)
"""Where effects may be named."""


def test_the_catalogue_goes_by_the_names_of_the_effects() -> None:
    assert all(effect.name == name for name, effect in EFFECTS.items())


def test_the_catalogue_is_every_file_of_its_folder() -> None:
    folder = ROOT / OWNERS[0]
    others = {'__init__', 'c_form', 'contract', 'effect', 'explanation', 'operators', 'resolution'}
    others.add('user_effects')
    assert {file.stem for file in folder.glob('*.py')} - others == set(EFFECTS)


@pytest.mark.parametrize('name', NAMES)
def test_effect_keeps_its_contract(name: str) -> None:
    assert check_effect(EFFECTS[name], explained=True) == []


def test_several_coefficients_go_by_the_symbols_of_the_equation() -> None:
    for effect in EFFECTS.values():
        symbols, count = effect.coefficient_symbols, len(effect.coefficient_units)
        if count == 1 or effect.per_run:  # cycles are numbered
            count = len(symbols)
        assert len(set(symbols)) == count, effect.name
        assert all(symbol.partition('_')[0] in effect.equation for symbol in symbols), effect.name


def test_the_page_of_the_effects_is_up_to_date() -> None:
    made = explain_all(EFFECTS)
    kept = (ROOT / 'doc' / 'physics.md').read_text('utf-8')
    command = 'python -m imu_workbench explain --all -o doc/physics.md'
    assert kept.strip() == made.strip(), f'doc/physics.md is stale: {command}'


@pytest.mark.parametrize('channel', CHANNELS)
def test_an_effect_may_need_any_channel(channel: str) -> None:
    assert np.isfinite(getattr(example_conditions(), channel)).all()


def texts(file: Path) -> Iterator[tuple[int, str]]:
    """Yield line and value of every string of a file that is not a docstring."""
    tree = ast.parse(file.read_text('utf-8'))
    bare = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in bare:
            yield node.lineno, node.value


def test_nothing_outside_the_effects_goes_by_their_names() -> None:
    # A channel may have the name of the effect it causes.
    names = set(EFFECTS) - set(CHANNELS)
    found = [
        f'{path}:{line}: {text}'
        for file in sorted((ROOT / 'src').rglob('*.py'))
        if not (path := str(file.relative_to(ROOT))).startswith(OWNERS)
        for line, text in texts(file)
        if text in names
    ]
    assert found == [], 'say it in an attribute of the effect'


def test_contract_finds_an_effect_that_looks_ahead() -> None:
    class LooksAhead(ThermalLag):
        def columns(self, conditions, state=None):
            return np.gradient(conditions.temperature)[:, None], None

    problems = check_effect(LooksAhead)
    assert any('cut' in problem for problem in problems)


def test_contract_finds_forms_that_a_search_could_not_tell_apart() -> None:
    class Alike(ThermalLag):
        def columns_in_hindsight(self, conditions):
            return np.gradient(conditions.temperature)[:, None]

    assert any('could not tell them apart' in problem for problem in check_effect(Alike))


WRONG = {
    'kin': ('relatives', 'kin'),
    'look_alikes': (('magic',), "'magic' is no other effect"),
    'separated_by_cycles': ('thermal_lag_two_stage', 'no tuple'),
    'coefficient_symbols': (('a', 'b'), '1 coefficient_units, but 2 coefficient_symbols'),
    'twin': ('thermal_lag', 'is no other effect'),
    'separated_by_poses': (('magnetometer',), 'does not act on'),
    'temperature_coefficient': ('yes', "temperature_coefficient is 'yes', expected True or False"),
    'names_cause': (None, 'names_cause is None, expected True or False'),
    'least_ratio': (-1.0, 'least_ratio is -1.0, expected a number from 0 on'),
    'separating_action': (('log it',), "separating_action is ('log it',), expected a text"),
    'guessed_channel': ('moisture', "guessed_channel 'moisture' is none of"),
    'repeatable': (True, 'is repeatable, but occurrences is empty'),
    'time_only': (True, 'columns depend on more than time_only says'),
    'guess': (classmethod(lambda cls: ThermalLag), "thermal_lag guesses the channel ''"),
    'live_forms': (lambda self: (), 'live_forms: the first is not the form itself'),
    'columns_in_hindsight': (
        lambda self, conditions: conditions.temperature,
        'columns_in_hindsight have shape (600,), columns (600, 1)',
    ),
    'coefficient_deviations': (
        lambda self: np.ones(3),
        'coefficient_deviations have shape (3,), expected (1, 3)',
    ),
    'line_frequency': (-0.1, 'line_frequency is -0.1, expected None or'),
}


@pytest.mark.parametrize('attribute', WRONG)
def test_contract_finds_an_attribute_that_cannot_be(attribute: str) -> None:
    value, problem = WRONG[attribute]
    wrong = type('Wrong', (ThermalLag,), {attribute: value, 'sensors': ('gyroscope',)})
    assert any(problem in found for found in check_effect(wrong)), check_effect(wrong)


def test_contract_finds_a_first_order_effect_without_time_constant() -> None:
    wrong = type('Wrong', (EFFECTS['bias_temperature_curvature'],), {'first_order': True})
    assert any('no shape parameter in s' in problem for problem in check_effect(wrong))


def test_contract_finds_a_guess_of_a_channel_that_is_needed_or_of_nothing() -> None:
    humidity = EFFECTS['humidity']
    wrong = type('Wrong', (humidity,), {'guessed_channel': 'humidity'})
    assert any('among the channels it needs' in problem for problem in check_effect(wrong))
    odd = type('Odd', (humidity,), {'guess': classmethod(lambda cls: 'humidity')})
    assert any('expected the class of an effect' in problem for problem in check_effect(odd))


def test_contract_finds_live_forms_that_start_with_another() -> None:
    wrong = type('Wrong', (ThermalLag,), {'live_forms': lambda self: (ThermalLag(7.0), self)})
    assert any('live_forms' in problem for problem in check_effect(wrong))


def test_contract_finds_a_search_that_leaves_the_bounds_or_the_effect() -> None:
    @dataclass(frozen=True)
    class Wrong(ThermalLag):
        @classmethod
        def search_grid(cls, campaign):
            return [Candidate(cls(1e6))]

    assert any('outside its bounds' in problem for problem in check_effect(Wrong))
    Wrong.search_grid = classmethod(lambda cls, _: [Candidate(ThermalLag())])  # type: ignore[method-assign]
    assert any('another effect' in problem for problem in check_effect(Wrong))
    Wrong.search_grid = classmethod(lambda cls, _: [Candidate(cls(), 0)])  # type: ignore[method-assign]
    assert any('per run' in problem for problem in check_effect(Wrong))

    class Halved(ThermalHysteresis):
        def parts(self):
            return super().parts()[:1]

        @classmethod
        def search_grid(cls, campaign):
            return [Candidate(cls((1.0, 2.0)))]

    assert any('parts' in problem for problem in check_effect(Halved))


def test_contract_finds_columns_that_outgrow_the_temperature() -> None:
    wrong = type('Wrong', (EFFECTS['bias_temperature_curvature'],), {'bends': False})
    assert any('say bends = True' in problem for problem in check_effect(wrong))


def test_lag_is_exact_for_a_ramp() -> None:
    conditions = example_conditions(seed=3)
    time = conditions.time - conditions.time[0]
    lagged, _ = follow(conditions.time, 0.03 * time, 100.0)
    np.testing.assert_allclose(lagged, 0.03 * (time - 100.0 + 100.0 * np.exp(-time / 100.0)))
