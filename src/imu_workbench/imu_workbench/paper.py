# SPDX-License-Identifier: Apache-2.0
"""The published numbers this project is compared with.

Betta et al., "Stress Testing for Performance Analysis of Orientation Estimation Algorithms",
IEEE Trans. Instrum. Meas. 71 (2022) 3528112, doi:10.1109/TIM.2022.3216400 (open access).
Magnetometer columns are labelled nT there; only µT is physically possible, and used here.
"""

from __future__ import annotations

import csv
from functools import cache
from importlib.resources import files
from typing import Any

CITATION = (
    'G. Betta et al., “Stress Testing for Performance Analysis of Orientation Estimation '
    'Algorithms”, IEEE Trans. Instrum. Meas. 71 (2022) 3528112, doi:10.1109/TIM.2022.3216400'
)

OVERALL_RANGES = {'gyroscope': 0.31, 'accelerometer': 5.92, 'magnetometer': 132.01}
"""Largest range of any channel as section IV states it [deg/s, m/s², µT]."""

SEGMENTS = ('reference', 'R1', 'R2', 'R3', 'R4')
"""Columns of Tables III–V: the quiet zone, then the four repetitions of the cycle."""

ANGLES = ('alpha', 'beta', 'gamma')
"""Euler angles of Tables VI and VII, taken as yaw, pitch, roll of the ZYX sequence."""


@cache
def tables_3_4_5() -> tuple[dict[str, Any], ...]:
    """Return the rows of Tables III–V: min, max, mean, std of a channel in a segment."""
    return _rows('tables_3_4_5.csv', ('min', 'max', 'mean', 'std'))


@cache
def tables_6_7() -> tuple[dict[str, Any], ...]:
    """Return the rows of Tables VI and VII: mean and standard deviation of an angle [deg]."""
    return _rows('tables_6_7.csv', ('mean_deg', 'std_deg'))


def _rows(name: str, numbers: tuple[str, ...]) -> tuple[dict[str, Any], ...]:
    text = (files('imu_workbench') / 'data' / name).read_text('utf-8')
    return tuple(
        {key: float(value) if key in numbers else value for key, value in row.items()}
        for row in csv.DictReader(text.splitlines())
    )
