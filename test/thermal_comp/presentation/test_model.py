# SPDX-License-Identifier: Apache-2.0
"""A model as text, table and picture: a line of 2 mm/s² a kelvin, in units for people."""

from __future__ import annotations

from dataclasses import replace

import pytest
from thermal_comp.effects import EFFECTS
from thermal_comp.presentation.model import picture, table, text

from ..models import line_model


def test_each_effect_is_a_line_with_its_rms_in_the_units_of_the_paper() -> None:
    title, gyroscope, accelerometer, magnetometer = text(line_model().to_dict()).splitlines()
    assert title == 'thermal model of dut1, fitted to 1 runs (z): rms of each effect'
    assert gyroscope.split() == ['gyroscope', 'bias_temperature', '1.15', '0.573', '0', '°/s']
    assert accelerometer.split()[2:] == ['0.0400', '0.0200', '0', 'm/s²']
    assert magnetometer.split()[2:] == ['0.600', '0.300', '0', 'µT']


def test_a_time_constant_is_told_with_its_standard_deviation() -> None:
    model = line_model()
    sensor = model.sensors['gyroscope']
    lagging = replace(
        sensor,
        effects=(EFFECTS['thermal_lag'](time_constant=123.4),),
        contributions={'thermal_lag': sensor.contributions['bias_temperature']},
        shape_std={'thermal_lag.time_constant': (2.5,)},
    )
    said = text(replace(model, sensors={'gyroscope': lagging}).to_dict())
    assert said.endswith('°/s  time constant 123.4 ± 2.5 s')


def test_names_are_escaped_in_the_table_and_a_device_without_one_is_said() -> None:
    html = table(replace(line_model(), device='<b>&').to_dict())
    assert 'thermal model of &lt;b&gt;&amp;, fitted' in html
    assert html.count('<tr>') == 1 + 3
    assert '<div>made by hand</div>' in html
    assert 'thermal model of a device that is not named' in table(
        replace(line_model(), device='').to_dict()
    )


def test_the_picture_goes_through_the_fitted_temperatures() -> None:
    panels = {panel.get_title(): panel for panel in picture(line_model()).axes}
    assert list(panels) == ['gyroscope', 'accelerometer', 'magnetometer']
    x, y, z = panels['accelerometer'].get_lines()
    temperature, error = x.get_data()
    assert (temperature.min(), temperature.max()) == pytest.approx((-10.0, 50.0), abs=0.4)
    assert error == pytest.approx(2e-3 * (temperature - 20.0), abs=1e-12)
    assert y.get_ydata() == pytest.approx(-0.5 * error)
    assert not z.get_ydata().any()
