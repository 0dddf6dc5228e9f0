# SPDX-License-Identifier: Apache-2.0
"""What enters a certified coefficient: standard uncertainties worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from imu_workbench.report.certificate.evidence import Evidence
from imu_workbench.report.certificate.quantities import (
    at_reference,
    chord,
    dwell_gradient,
    power_of_kelvin,
    temperature_inputs,
)
from imu_workbench.report.certificate.references import reference_of_bias
from imu_workbench.report.laboratory import Laboratory
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS

from imu_recording import ImuRecording


def evidence(
    sensor: str = 'gyroscope', up: tuple[str, ...] = (), residual: Any = None, **stated: Any
) -> Evidence:
    """Return evidence from −10 to 50 °C of runs with these axes up, and what a laboratory says."""
    temperature = np.linspace(-10.0, 50.0, 601)
    left = np.zeros((601, 3)) if residual is None else residual(temperature)[:, None] * np.ones(3)
    joint = SimpleNamespace(temperature=temperature, residual=left)
    return Evidence(
        sensor=sensor,
        model=None,
        runs=(None,) * len(up),
        up_axes=up,
        repeated=None,
        joint=joint,
        laboratory=Laboratory(stated),
        span=60.0,
        gradient=None,
        reference_temperature=20.0,
    )


def test_a_certificate_of_a_thermometer_counts_twice_between_two_ends() -> None:
    told = evidence(thermometer={'expanded_uncertainty': 0.2}, gradient={'half_width': 0.3})
    for span, factor in ((False, 1.0), (True, math.sqrt(2.0))):
        (thermometer, gradient), missing = temperature_inputs(told, span=span)
        assert thermometer.uncertainty == pytest.approx(0.1 * factor)  # k = 2
        assert gradient.uncertainty == pytest.approx(0.3 / math.sqrt(3.0))
        assert missing == []


def test_what_nobody_stated_is_said_to_be_missing() -> None:
    inputs, missing = temperature_inputs(evidence(), span=False)
    assert inputs == []
    assert [one.source for one in missing] == [
        'thermometer calibration',
        'gradient thermometer to die',
    ]
    scattered = replace(evidence(), gradient=np.array([-0.5, -0.3, -0.7]))
    (ends,), _ = temperature_inputs(scattered, span=True)
    assert (ends.uncertainty, ends.degrees) == (pytest.approx(0.2), 2.0)


def test_the_true_input_of_a_bias_is_known_where_gravity_or_rest_tells_it() -> None:
    runs, reference, (earth,), _ = reference_of_bias(evidence(up=('+x', '+z')), 0)
    assert (runs, reference) == ([0, 1], {0: 0.0, 1: 0.0})
    assert earth.uncertainty == pytest.approx(7.292e-5 / math.sqrt(3.0), rel=1e-3)
    level = evidence('accelerometer', ('+x', '-z'), mounting={'tilt_half_width': 1.0})
    runs, _, (tilt,), _ = reference_of_bias(level, 0)
    assert runs == [1]
    assert tilt.uncertainty == pytest.approx(9.80665 * math.sin(math.radians(1.0)) / 3**0.5)
    upright = evidence('accelerometer', ('+x', '-x'))
    _, reference, _, (warning,) = reference_of_bias(upright, 0)
    assert reference == {0: pytest.approx(9.80665), 1: pytest.approx(-9.80665)}
    assert 'the axis stood upright' in str(warning)
    assert reference_of_bias(evidence('magnetometer', ('+x',)), 0)[0] == []


def test_a_slope_may_be_off_by_what_the_residual_rises_from_end_to_end() -> None:
    rising = evidence(residual=lambda t: 3e-6 * (t - 20.0))
    assert chord(rising, 1) == pytest.approx(3e-6 / math.sqrt(3.0))
    assert at_reference(rising, 1) == pytest.approx(0.0, abs=1e-12)
    level = evidence(residual=lambda t: np.full_like(t, 2e-4))
    assert chord(level, 0) == 0.0
    assert at_reference(level, 0) == pytest.approx(2e-4 / math.sqrt(3.0))


def test_the_power_of_kelvin_is_read_from_the_unit() -> None:
    units = ('T/K', 'T/K²', 'T/K³', 'T', 'rad/s/(K·m/s²)', 'K', 's')
    assert [power_of_kelvin(u) for u in units] == [1, 2, 3, 0, 1, -1, 0]


def test_the_gradient_is_that_of_thermocouple_and_die(run: Callable[..., ImuRecording]) -> None:
    recording = run(cycles=2)  # its thermocouple reads half a kelvin less
    gradient = dwell_gradient(prepare([recording]))
    assert gradient is not None
    assert gradient == pytest.approx(np.full(6, -0.5))  # three dwells of two cycles
    assert dwell_gradient(prepare([replace(recording, device_temperature=None)])) is None


def test_one_unit_of_an_effect_is_that_of_all_its_coefficients() -> None:
    widths = EFFECTS['thermal_hysteresis']((3.0, 8.0))
    assert widths.units_of_coefficients(2, 'm/s²') == ['m/s²/K', 'm/s²/K']
    bent = EFFECTS['bias_temperature_curvature']()
    assert bent.units_of_coefficients(2, 'T') == ['T/K²', 'T/K³']
