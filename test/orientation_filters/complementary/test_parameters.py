# SPDX-License-Identifier: Apache-2.0
"""Named parameters of the complementary filter: cut-offs become rates, in three frames."""

from __future__ import annotations

import math

import pytest
from imu_recording.ros.parameter import ParameterError
from orientation_filters.complementary.parameters import ComplementaryParameters
from orientation_filters.filters import filter_parameters


def test_a_cut_off_of_half_a_hertz_is_pi_radians_a_second() -> None:
    params = ComplementaryParameters(cutoff_hz=0.5).kernel_params()
    assert params.inclination_rate == pytest.approx(math.pi)
    assert params.heading_rate == params.inclination_rate
    apart = ComplementaryParameters(cutoff_hz=0.5, heading_cutoff_hz=0.25).kernel_params()
    assert apart.heading_rate == pytest.approx(0.5 * math.pi)
    assert apart.inclination_rate == params.inclination_rate


@pytest.mark.parametrize(
    ('world_frame', 'up', 'north'),
    [('enu', 1.0, (0.0, 1.0)), ('ned', -1.0, (1.0, 0.0)), ('nwu', 1.0, (1.0, 0.0))],
)
def test_the_frames_have_north_and_up_where_their_names_say(
    world_frame: str, up: float, north: tuple[float, float]
) -> None:
    params = ComplementaryParameters(world_frame=world_frame).kernel_params()
    assert (params.up, params.north) == (up, pytest.approx(north))


def test_noises_of_the_means_are_those_at_which_a_kalman_filter_has_these_cut_offs() -> None:
    """An angle with random walk q, measured with density r, settles to a gain of q / r."""
    params = ComplementaryParameters(
        cutoff_hz=0.03, heading_cutoff_hz=0.015, angle_random_walk=3e-4
    ).kernel_params()
    walk, means = 3e-4, params.averaging
    assert walk / (means.acceleration_floor / 9.81) == pytest.approx(2.0 * math.pi * 0.03)
    assert walk / means.heading_noise == pytest.approx(2.0 * math.pi * 0.015)


def test_the_robust_preset_adapts_and_its_values_may_be_overridden() -> None:
    robust = filter_parameters('complementary', preset='robust', cutoff_hz=1.0)
    assert robust.adaptive
    assert robust.learn_bias
    assert robust.kernel_params().inclination_rate == pytest.approx(2.0 * math.pi)
    assert not filter_parameters('complementary').adaptive


@pytest.mark.parametrize(('name', 'value'), [('cutoff_hz', 0.0), ('rest_bias_time', -1.0)])
def test_a_value_out_of_range_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=name):
        filter_parameters('complementary', **{name: value})
