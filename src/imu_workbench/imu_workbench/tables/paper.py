# SPDX-License-Identifier: Apache-2.0
"""Numbers published in the paper, read from data/, and where they cannot be right.

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

PAPER_PROFILE = 'paper_betta2022'
"""Chamber profile of the paper's campaigns."""
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


_FINDINGS = {
    'Tables III–V, unit of the magnetometer': (
        'Printed as nT. Quiet-zone norms of 37, 42 and 34 are µT (Italy has about 46 µT); '
        'reports show µT, topics carry tesla.'
    ),
    'Tables III–V, minimum and σ of large channels': (
        'In the quiet zone minimum/mean is 0.54 and σ/mean 5.4, 6.2 and 5.8 % on all '
        'accelerometer and magnetometer channels of a device at once: one common start-up '
        'transient, not temperature. It is cut before statistics are taken.'
    ),
    'Section IV, overall ranges': (
        '5.92 m/s² is DUT3 z R4, whose minimum is such a start-up sample; off the gravity axis '
        'the largest range is 3.06 m/s². The tables hold larger ranges than stated: 5.98 m/s² '
        '(DUT2 y R1), 0.48 °/s (DUT1 x R4) or 0.40 °/s (DUT2 y R1). 132.01 µT occurs in R2 '
        'only.'
    ),
    'Table III, magnetometer z R4': (
        'Mean −119.01 lies outside its own range of −108.36 … −42.65.'
    ),
    'Table III, gyroscope x R4': (
        'The minimum of −0.46 lies 44 standard deviations from the mean: a spike or a misprint.'
    ),
    'Table IV, accelerometer y R4': (
        'Gravity has the opposite sign from R1–R3: a remounted device, or a sign error.'
    ),
    'Table IV, gyroscope z Reference': (
        'A standard deviation of 0.03 inside a range of 0.01 cannot be, rounding included; DUT2 '
        'gyroscope x Reference and DUT1 gyroscope z R4 are at the limit of what can be.'
    ),
    'Tables III–V, levels between the columns': (
        'The mean magnetic norm goes 37, 46, 163, 126, 136 µT (DUT1) while the specific force '
        'stays: no temperature slope does that. It takes a field or a board that changed '
        'between the columns.'
    ),
    'Tables III–V, gyroscope': (
        'Mean and σ of all three axes are identical for DUT2 R1 and DUT3 R3, DUT2 R3 and DUT3 '
        'R4, DUT2 R4 and DUT3 R1; R2 agrees over all three tables. The columns behave like '
        'boards that were swapped between tables, not like repetitions of one board.'
    ),
    'Section IV, orientation': (
        'Each table shows one device in one orientation, so that they cannot tell device from '
        'orientation. In one pose scale factor and bias cannot be told apart either.'
    ),
    'Section IV against V, devices': (
        'The influence is called similar whatever the device, and different for each device, '
        'with slopes of opposite sign.'
    ),
    'Section II, duration': (
        'A cycle is 150 min and four are 10 h; with 30 min at the end “approximately 12 h” '
        'leaves 90 min for a preconditioning the text does not state.'
    ),
    'Section V, linearity and Gaussianity': (
        'One slope over four runs with jumps between them; no uncertainty, no held-out data, no'
        ' term for history.'
    ),
    'Figure 4': ('The caption says DUT1 with X up, section V says DUT1 with Y up.'),
    'Equation (2), states': (
        'b and a are called acceleration error and magnetic disturbance; in the algorithm they '
        'are gyroscope bias and linear acceleration. As an indirect filter it has F = 0, and '
        'the cited reference is about an average filter.'
    ),
    'Section VI, filter settings': (
        'A cut-off of 3 Hz is given without a sample rate, and the filter’s implementation has '
        'no such property.'
    ),
    'Section VI, Euler angles': (
        'With X up the ZYX pitch is ±90°, where yaw and roll are one angle; the mount of Tables'
        ' VI and VII is not stated. Here angles are relative to the start, with rotation angle,'
        ' heading and inclination beside them.'
    ),
    'Section VI, frame': ('“NED” with +9.8 on the vertical axis is not NED for specific force.'),
    'Tables VI and VII, α and γ': (
        'Their means are identical for all devices and both filters: copied columns. They are '
        'shown, never taken as a target.'
    ),
    'Tables III–V against VII': (
        'Headings implied by the mean fields turn by up to 170° between columns, so that σ of '
        '0.1 … 0.5° cannot come from all columns with one model.'
    ),
    'Section VI C, one order of magnitude': (
        'Smaller σ holds in 18 of 18 cells, the weakest by a factor of 1.06; more than a factor'
        ' of ten for each angle and device does not: DUT2 α goes from 0.6 to 0.2.'
    ),
    'Conclusion, more accurate': (
        'The mean β of the AHRS gets worse for DUT1 (−1.7 to −10.3°) and DUT2 (4.4 to −6.3°).'
    ),
}

PAPER_NOTES: tuple[dict[str, str], ...] = tuple(
    {'place': place, 'finding': finding} for place, finding in _FINDINGS.items()
)
"""Place in the paper and what is wrong there."""
