# SPDX-License-Identifier: Apache-2.0
"""What every effect of the catalogue promises."""

import numpy as np
import pytest
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.contract import check_effect, example_conditions

NAMES = sorted(EFFECTS)
ISSUE_NAMES = {
    'bias_temperature', 'bias_temperature_curvature', 'scale_factor_temperature',
    'misalignment_temperature', 'g_sensitivity_temperature', 'thermal_lag',
    'thermal_lag_two_stage', 'temperature_rate', 'thermal_gradient', 'thermal_hysteresis',
    'warm_up', 'supply_sensitivity', 'vibration_rectification', 'humidity', 'turn_on_bias',
    'bias_step', 'bias_drift', 'bias_creep', 'heater_hard_iron', 'compressor_hard_iron',
    'fixture_hard_iron', 'fixture_tilt', 'mains_alias', 'icing',
}  # fmt: skip


def test_the_catalogue_is_complete() -> None:
    assert set(EFFECTS) == ISSUE_NAMES
    assert all(effect.name == name for name, effect in EFFECTS.items())


@pytest.mark.parametrize('name', NAMES)
def test_effect_keeps_its_contract(name: str) -> None:
    assert check_effect(EFFECTS[name]) == []


@pytest.mark.parametrize('name', NAMES)
def test_look_alikes_are_in_the_catalogue(name: str) -> None:
    assert set(EFFECTS[name].look_alikes) <= set(EFFECTS) - {name}


@pytest.mark.parametrize('name', NAMES)
def test_campaign_effects_are_the_ones_of_chamber_fixture_and_session(name: str) -> None:
    campaign = {
        'turn_on_bias', 'bias_step', 'bias_drift', 'bias_creep', 'heater_hard_iron',
        'compressor_hard_iron', 'fixture_hard_iron', 'fixture_tilt', 'mains_alias', 'icing',
    }  # fmt: skip
    assert (EFFECTS[name].kind == 'campaign') == (name in campaign)


def test_contract_finds_an_effect_that_looks_ahead() -> None:
    lag = EFFECTS['thermal_lag']

    class LooksAhead(lag):  # type: ignore[misc, valid-type]
        def columns(self, conditions, state=None):
            return np.gradient(conditions.temperature)[:, None], None

    problems = check_effect(LooksAhead)
    assert any('cut' in problem for problem in problems)


def test_lag_is_exact_for_a_ramp() -> None:
    conditions = example_conditions(seed=3)
    time = conditions.time - conditions.time[0]
    from thermal_comp.effects.operators import follow

    lagged, _ = follow(conditions.time, 0.03 * time, 100.0)
    np.testing.assert_allclose(lagged, 0.03 * (time - 100.0 + 100.0 * np.exp(-time / 100.0)))
