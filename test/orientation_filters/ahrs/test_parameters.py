# SPDX-License-Identifier: Apache-2.0
"""Named parameters of the AHRS: MathWorks' defaults, the units the kernel works in."""

from __future__ import annotations

import math

import pytest
from imu_recording.ros.parameter import ParameterError
from orientation_filters.ahrs.parameters import AhrsParameters
from orientation_filters.filters import filter_parameters


def test_the_noises_are_those_that_ahrsfilter_documents() -> None:
    noise = AhrsParameters().kernel_params().noise
    assert noise._asdict() == {
        'accelerometer': 0.00019247,
        'magnetometer': 0.1,
        'gyroscope': 9.1385e-5,
        'gyroscope_drift': 3.0462e-13,
        'linear_acceleration': 0.0096236,
        'linear_acceleration_decay': 0.5,
        'magnetic_disturbance': 0.5,
        'magnetic_disturbance_decay': 0.5,
    }


def test_the_kernel_counts_the_field_in_microtesla() -> None:
    assert AhrsParameters().kernel_params().field_strength == pytest.approx(50.0)
    assert AhrsParameters(expected_field=25e-6).kernel_params().field_strength == pytest.approx(25)


@pytest.mark.parametrize(
    ('world_frame', 'up', 'north'),
    [('enu', 1.0, (0.5, math.sqrt(0.75))), ('ned', -1.0, (math.sqrt(0.75), 0.5))],
)
def test_magnetic_north_lies_east_of_north_by_the_declination(
    world_frame: str, up: float, north: tuple[float, float]
) -> None:
    params = AhrsParameters(
        world_frame=world_frame, magnetic_declination=math.radians(30.0)
    ).kernel_params()
    assert params.up == up
    assert params.north == pytest.approx(north)


def test_the_presets_differ_in_that_one_adapts() -> None:
    assert not filter_parameters('ahrs', preset='paper').kernel_params().adaptive
    assert filter_parameters('ahrs', preset='robust').kernel_params().adaptive


@pytest.mark.parametrize(
    ('name', 'value'), [('expected_field', 50.0), ('implementation', 'fast'), ('max_gap', 0.0)]
)
def test_a_value_out_of_range_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(ParameterError, match=name):
        filter_parameters('ahrs', **{name: value})
