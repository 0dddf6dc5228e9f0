# SPDX-License-Identifier: Apache-2.0
"""Laws near to an effect of the catalogue are not given its name; the effect itself is."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.noise.estimation import fit_noise

from ..campaign import WHITE, chamber, run

PERIOD = 20.0
SENSOR = 'gyroscope'
GAINS = np.array([1.2, -0.7, 0.9])
DIE = chamber(period=PERIOD)[1]
NAMES = ('bias_temperature_curvature', 'thermal_lag', 'icing')


def decided(law: np.ndarray) -> SensorAnswer:
    """Return what is said of a law (n,) of three times the noise of a second's mean."""
    straight = np.polyval(np.polyfit(DIE, law, 1), DIE)
    error = np.multiply.outer(
        law / np.std(law - straight), 3.0 * WHITE['angular_velocity'] * GAINS
    )
    recordings = [
        run(up, seed=k, period=PERIOD, error={'angular_velocity': error})
        for k, up in enumerate(('+x', '+z'))
    ]
    runs = prepare(recordings)
    base = {SENSOR: (EFFECTS['bias_temperature'](),)}
    settings = Settings({name: EFFECTS[name] for name in NAMES})
    return search_sensors(runs, base, {SENSOR: fit_noise(runs, SENSOR)}, settings)[SENSOR]


@pytest.mark.parametrize(
    'bend', [30.0, *(pytest.param(b, marks=pytest.mark.long) for b in (-2.0, 9.0))]
)
def test_a_line_with_one_bend_is_no_curvature(bend: float) -> None:
    answer = decided(np.maximum(DIE - bend, 0.0))
    assert (answer.kind, answer.named) == ('unexplained', ())
    assert answer.likeliest.depends_on in {'temperature', 'branch'}


def test_a_smooth_curve_is_a_curvature() -> None:
    x = (DIE - 20.0) / 30.0
    (named,) = decided(x**2 - 0.3 * x**3).named
    assert named.name == 'bias_temperature_curvature'


def test_what_is_proportional_to_a_channel_is_its_law_and_no_sum_of_drifts() -> None:
    time = chamber(period=PERIOD)[0]
    share = time / time[-1]
    pressure = 101_325.0 - 500.0 * share**1.5 + 40.0 * np.sin(2.0 * np.pi * time / 4000.0)
    error = (pressure - pressure.mean())[:, None] * 6e-7 * GAINS
    recording = run(period=PERIOD, error={'angular_velocity': error})
    runs = prepare([replace(recording, pressure=pressure)])
    base = {SENSOR: (EFFECTS['bias_temperature'](),)}
    names = ('bias_drift', 'bias_creep', 'warm_up', 'thermal_lag')
    settings = Settings({name: EFFECTS[name] for name in names})
    answer = search_sensors(runs, base, {SENSOR: fit_noise(runs, SENSOR)}, settings)[SENSOR]
    assert answer.kind == 'unexplained'
    assert answer.likeliest.depends_on == 'pressure'
    assert answer.likeliest.probability > 0.9
