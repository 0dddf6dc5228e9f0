# SPDX-License-Identifier: Apache-2.0
"""Grids as fine as an effect is narrow: no dip falls between two of their values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from thermal_comp.effects.resolution import example_cycle, refined, thinned

TEMPERATURE = example_cycle('gyroscope').temperature


def dip(centre: float, width: float = 3.0) -> np.ndarray:
    return np.exp(-0.5 * ((TEMPERATURE - centre) / width) ** 2)[:, None]


def test_neighbouring_dips_overlap() -> None:
    """Bells of width s a distance d apart correlate as exp(−d² / 4 s²): 0.7 at 1.2 s."""
    grid = refined([-40.0, 0.0, 40.0, 80.0], dip)
    assert {-40.0, 0.0, 40.0, 80.0} <= set(grid)
    assert np.diff(grid).max() < 1.4 * 3.0
    assert np.diff(grid).min() > 0.5 * 3.0


def test_a_broad_effect_keeps_its_few_values_and_times_are_halved_in_ratio() -> None:
    assert refined([-20.0, 20.0], lambda c: dip(c, 60.0)) == [-20.0, 20.0]
    grid = refined([1.0, 64.0], lambda value: dip(10.0 * math.log2(value), 6.0))
    ratios = np.log2(np.array(grid))
    assert np.diff(ratios) == pytest.approx(ratios[1] - ratios[0])


def test_a_line_in_temperature_has_no_form_of_its_own_and_ends() -> None:
    grid = refined([1.0, 2.0], lambda value: value * TEMPERATURE[:, None])
    assert len(grid) <= 65


def test_several_parameters_together_stay_countable() -> None:
    values = [list(map(float, range(n))) for n in (65, 20, 3)]
    kept = thinned(values)
    assert math.prod(map(len, kept)) <= 400
    assert all(set(few) <= set(many) for few, many in zip(kept, values, strict=True))
    assert kept[2] == values[2]
    assert thinned([[1.0], [2.0, 3.0]]) == [[1.0], [2.0, 3.0]]


def test_the_example_passes_all_temperatures_twice_with_every_channel() -> None:
    conditions = example_cycle('magnetometer')
    assert (conditions.temperature.min(), conditions.temperature.max()) == (-45.0, 90.0)
    assert np.sum(conditions.temperature == -45.0) == 2
    assert set(conditions.cycle.tolist()) == {1, 2}
    for name in ('chamber_temperature', 'humidity', 'supply_voltage', 'vibration', 'heater'):
        assert np.isfinite(getattr(conditions, name)).all()
