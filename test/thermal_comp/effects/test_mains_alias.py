# SPDX-License-Identifier: Apache-2.0
"""A line of a machine is there while the machine is on."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import Settings, diagnose_prepared
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.contract import EXAMPLE_CAMPAIGN
from thermal_comp.effects.mains_alias import MainsAlias
from thermal_comp.effects.resolution import example_cycle
from thermal_comp.fitting.fit import fit_prepared

from ..campaign import WHITE, chamber, run


def test_a_machine_is_tried_only_where_it_was_logged() -> None:
    none = replace(EXAMPLE_CAMPAIGN, channels=frozenset())
    logged = replace(EXAMPLE_CAMPAIGN, channels=frozenset({'heater', 'humidity'}))
    both = replace(EXAMPLE_CAMPAIGN, channels=frozenset({'heater', 'compressor'}))
    assert {c.effect.machine for c in MainsAlias.search_grid(none)} == {0.0}
    assert {c.effect.machine for c in MainsAlias.search_grid(logged)} == {0.0, 1.0}
    assert {c.effect.machine for c in MainsAlias.search_grid(both)} == {0.0, 1.0, 2.0}


def test_a_line_is_as_strong_as_its_machine_is_on() -> None:
    conditions = replace(example_cycle('magnetometer'), heater=None)
    steady = MainsAlias(0.0123).columns(conditions)[0]
    state = np.linspace(0.0, 1.0, len(conditions))
    heated = replace(conditions, heater=state)
    assert np.array_equal(MainsAlias(0.0123, 0.0, 1.0).columns(heated)[0], steady * state[:, None])
    assert np.array_equal(MainsAlias(0.0123, 0.0, 1.0).columns(conditions)[0], steady)
    assert np.array_equal(MainsAlias(0.0123).columns(heated)[0], steady)


@pytest.mark.long
def test_a_line_that_comes_and_goes_with_the_heater_is_named() -> None:
    time = chamber(2)[0]
    heater = (np.sin(time / 700.0) > 0.2).astype(float)
    axes = np.array([1.0, -0.6, 0.8])
    wave = 8.0 * WHITE['magnetic_field'] * (heater * np.cos(2.0 * np.pi * 0.0102 * time))[:, None]
    recordings = [
        replace(run(seed=5, cycles=2, error={'magnetic_field': wave * axes}), heater=heater)
    ]
    found = diagnose_prepared(prepare(recordings), None, Settings(EFFECTS))
    named = [(f.name, f.probability) for f in found.findings if f.kind == 'effect']
    assert [name for name, _ in named] == ['mains_alias']
    assert named[0][1] > 0.9


def test_a_fit_leaves_a_line_where_the_spectrum_has_it() -> None:
    time = chamber(2)[0]
    line = 4.0 * np.cos(2.0 * np.pi * 0.0102 * time)
    slow = 20.0 * np.sin(2.0 * np.pi * time / 9000.0)
    error = WHITE['magnetic_field'] * np.outer(line + slow, [1.0, -0.6, 0.8])
    runs = prepare([run(seed=6, cycles=2, error={'magnetic_field': error})])
    model = fit_prepared({'magnetometer': (BiasTemperature(), MainsAlias())}, runs)
    (fitted,) = [e for e in model.sensors['magnetometer'].effects if e.name == 'mains_alias']
    assert isinstance(fitted, MainsAlias)
    assert fitted.frequency == pytest.approx(0.0102, abs=2e-5)
