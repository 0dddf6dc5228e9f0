# SPDX-License-Identifier: Apache-2.0
"""A line in the spectrum is an alias of the mains only while it keeps frequency and phase."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from thermal_comp.data.preparation import PreparedRun, prepare
from thermal_comp.diagnosis.decision import STEADY, Outcome
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.diagnosis.spectral_lines import spectral_lines, steadiness
from thermal_comp.effects import EFFECTS
from thermal_comp.noise.estimation import fit_noise

from ..campaign import PERIOD, WHITE, chamber, run

GAINS = np.array([1.0, -0.7, 0.8])
HERTZ = 0.0071
SENSOR = 'magnetometer'


@cache
def runs_with(line: Callable[[], np.ndarray]) -> list[PreparedRun]:
    size = 2.0 * WHITE['magnetic_field']
    error = {'magnetic_field': size * np.multiply.outer(line(), GAINS)}
    return prepare([run(up, seed=k, error=error) for k, up in enumerate(('+x', '+y', '+z'))])


def decided(runs: list[PreparedRun]) -> Outcome:
    catalogue = {name: EFFECTS[name] for name in ('mains_alias', 'warm_up')}
    base = {SENSOR: (EFFECTS['bias_temperature'](),)}
    return search_sensors(runs, base, {SENSOR: fit_noise(runs, SENSOR)}, Settings(catalogue))[
        SENSOR
    ]


def steady() -> np.ndarray:
    return np.asarray(np.cos(2.0 * np.pi * HERTZ * chamber()[0]))


def gated() -> np.ndarray:
    """A current that flows half of the time, an hour long."""
    return np.asarray(steady() * (chamber()[0] // 3600 % 2))


def moving() -> np.ndarray:
    """A beat of two clocks, one of which feels the temperature: 2 ‰ per kelvin."""
    frequency = HERTZ * (1.0 + 2e-3 * (chamber()[1] - 20.0))
    return np.asarray(np.cos(2.0 * np.pi * np.cumsum(frequency) * PERIOD))


@pytest.mark.parametrize('line', [steady, gated])
def test_a_line_that_keeps_its_phase_is_named(line: Callable[[], np.ndarray]) -> None:
    (named,) = decided(runs_with(line)).named
    assert named.scored.name == 'mains_alias'
    assert named.scored.form.effect.shape_parameters['frequency'] == pytest.approx(HERTZ, abs=3e-6)


def test_a_line_that_moves_with_temperature_is_not() -> None:
    outcome = decided(runs_with(moving))
    assert (outcome.kind, outcome.depends_on, outcome.named) == ('unexplained', 'frequency', ())


def test_steadiness_is_the_share_that_one_phasor_has() -> None:
    assert steadiness(runs_with(steady), SENSOR, HERTZ) == pytest.approx(1.0, abs=0.02)
    assert steadiness(runs_with(gated), SENSOR, HERTZ) == pytest.approx(0.5, abs=0.05)
    wandering = runs_with(moving)
    (strongest, *_) = spectral_lines(wandering, SENSOR)
    assert steadiness(wandering, SENSOR, strongest) < STEADY
