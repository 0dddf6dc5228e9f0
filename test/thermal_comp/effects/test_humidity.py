# SPDX-License-Identifier: Apache-2.0
"""The humidity of closed air follows from its dew point and its temperature."""

import numpy as np
import pytest
from scipy.linalg import solveh_banded
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.humidity import GuessedHumidity, Humidity

HELD_S = 20_000.0
"""Long beside the lag: what is taken up is the humidity."""


def taken_up(die: float, air: float | None, dew_point: float) -> float:
    """Return what the package has taken up of air held at a temperature [°C]."""
    time = np.arange(0.0, HELD_S, 10.0)
    held = np.full(len(time), die)
    outside = None if air is None else np.full(len(time), air)
    still = np.zeros((len(time), 3))
    conditions = Conditions(time, held, still, still, still, chamber_temperature=outside)
    return float(GuessedHumidity(600.0, dew_point=dew_point).columns(conditions)[0][-1, 0])


@pytest.mark.parametrize(
    ('air', 'dew_point', 'humidity'),
    [
        # Vapour pressures over water [hPa], tables of WMO No. 8: 12.27 at 10 °C, 23.37 at 20 °C,
        # 6.11 at 0 °C, 42.43 at 30 °C.
        (20.0, 10.0, 12.27 / 23.37),
        (30.0, 0.0, 6.11 / 42.43),
    ],
)
def test_relative_humidity_agrees_with_tables_of_vapour_pressure(
    air: float, dew_point: float, humidity: float
) -> None:
    assert taken_up(air, None, dew_point) == pytest.approx(humidity, rel=5e-3)


def test_moisture_diffuses_into_a_slab_as_layers_of_it_say() -> None:
    """Fick's law between 200 layers, dry at first, in a humidity that rises for an hour."""
    layers, step = 200, 0.5
    time = np.arange(0.0, 6000.0, step)
    outside = np.clip(time / 3600.0, 0.0, 1.0)
    slowest = 1500.0  # 4 L² / (π² D) of a slab of thickness L, open on one side
    rate = 4.0 * layers**2 / (np.pi**2 * slowest)
    into = solveh_banded(
        np.array(
            [
                np.r_[0.0, np.full(layers - 1, -step * rate)],
                1.0 + step * rate * np.r_[3.0, np.full(layers - 2, 2.0), 1.0],
            ]
        ),
        np.eye(layers),
    )
    moisture, inside = np.zeros(layers), []
    for humidity in outside:
        moisture[0] += 2.0 * step * rate * humidity
        moisture = into @ moisture
        inside.append(moisture.mean())
    still = np.zeros((len(time), 3))
    conditions = Conditions(time, outside, still, still, still, humidity=outside)
    taken_up = Humidity(slowest, by_diffusion=1.0).columns(conditions)[0][:, 0]
    assert np.abs(taken_up - inside).max() < 0.02
    first, last = conditions.at(time[:5000]), conditions.at(time[5000:])
    one, state = Humidity(slowest, by_diffusion=1.0).columns(first)
    other, _ = Humidity(slowest, by_diffusion=1.0).columns(last, state)
    assert np.concatenate([one, other])[:, 0] == pytest.approx(taken_up, abs=1e-12)
    alone = Humidity(slowest).columns(conditions)[0][:, 0]
    assert np.abs(alone - inside).max() > 0.04


def test_cold_air_holds_no_more_water_than_its_saturation() -> None:
    assert taken_up(-10.0, None, 10.0) == 1.0


def test_the_air_is_the_chambers_where_that_was_logged() -> None:
    assert taken_up(45.0, 20.0, 10.0) == taken_up(20.0, None, 10.0)


def test_the_guess_is_no_effect_that_a_model_can_hold() -> None:
    assert GuessedHumidity.name not in EFFECTS
    assert EFFECTS['humidity'].guess() is GuessedHumidity
    assert GuessedHumidity.guess() is None
