# SPDX-License-Identifier: Apache-2.0
"""A gyroscope in one thermal cycle, searched for a few effects: a diagnosis in two seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.noise.of_runs import determined_noise

from ..campaign import chamber, lagging, run

PERIOD = 20.0
CATALOGUE = ('warm_up', 'thermal_lag')


def behind(time_constant: float) -> np.ndarray:
    """(n,) what a node with this time constant [s] is ahead of the die [K]."""
    _, die, *_ = chamber(1, PERIOD)
    return die - lagging(die, time_constant, PERIOD)


def searched(
    error: np.ndarray, names: Sequence[str] = CATALOGUE, supply: np.ndarray | None = None
) -> SensorAnswer:
    """Return which effects explain an error (n,) that the axes feel as 1, −0.5 and 0.7."""
    shaped = {'angular_velocity': error[:, None] * np.array([1.0, -0.5, 0.7])}
    recording = run(cycles=1, period=PERIOD, error=shaped)
    runs = prepare([replace(recording, supply_voltage=supply)])
    base = {'gyroscope': (EFFECTS['bias_temperature'](),)}
    settings = Settings({name: EFFECTS[name] for name in names})
    return search_sensors(runs, base, determined_noise(runs, base)[0], settings)['gyroscope']


@cache
def lagging_gyroscope() -> SensorAnswer:
    """Return what explains a lag of 300 s that is well above the noise."""
    return searched(1.5e-4 * behind(300.0))
