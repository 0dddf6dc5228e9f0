# SPDX-License-Identifier: Apache-2.0
"""Pictures for paper: every panel has its name and unit, and missing tracks leave theirs empty."""

from __future__ import annotations

import re
from html import unescape

from imu_workbench.report.figures.printed import allan_picture, run_picture

LINE = {'x': [0.0, 1.0, None, 2.0], 'y': [0.1, -0.1, None, 0.2]}
RESIDUALS = {
    'gyroscope': {'unit': '°/s', 'floor': [0.01] * 3, 'axes': dict.fromkeys('xyz', LINE)},
    'accelerometer': {'unit': 'm/s²', 'floor': [0.02] * 3, 'axes': dict.fromkeys('xyz', LINE)},
}


def texts(svg: str) -> list[str]:
    """Return the texts of a picture, which stay texts."""
    return [unescape(text).strip() for text in re.findall(r'<text[^>]*>([^<]*)</text>', svg)]


def test_a_run_has_a_panel_of_temperatures_and_one_of_each_sensor() -> None:
    plan = {'tracks': {'set-point': LINE, 'die': LINE}}
    said = texts(run_picture(plan, RESIDUALS))
    assert 'temperature [°C]' in said
    assert {'gyroscope residual [°/s]', 'accelerometer residual [m/s²]', 'time [h]'} <= set(said)
    assert said.count('± 2 σ of noise') == 2
    assert {'set-point', 'die'} <= set(said)


def test_a_run_without_a_plan_has_residuals_alone() -> None:
    said = texts(run_picture(None, RESIDUALS))
    assert 'set-point' not in said
    assert 'gyroscope residual [°/s]' in said


def test_the_allan_deviation_has_a_panel_per_sensor_and_is_the_same_every_time() -> None:
    curve = {'tau': [1.0, 2.0], 'deviation': [0.2, 0.1], 'low': [0.1, 0.05], 'high': [0.3, 0.2]}
    curves = {'gyroscope': {'x': curve}, 'accelerometer': {'x': curve}}
    picture = allan_picture(curves)
    assert {'Gyroscope [°/s]', 'Accelerometer [m/s²]'} <= set(texts(picture))
    assert picture == allan_picture(curves)
