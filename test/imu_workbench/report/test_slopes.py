# SPDX-License-Identifier: Apache-2.0
"""Slopes per cycle find what was put in, and the tests tell chance from effect."""

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.report.slopes import block_slopes, compare_devices, compare_orientations

PUT_IN = np.array([2e-3, -1e-3, 3e-3])


def test_every_cycle_gives_the_slope_put_in(run) -> None:
    recording = run()
    slopes = block_slopes(recording, recording.linear_acceleration)
    assert slopes.shape == (4, 3)
    np.testing.assert_allclose(slopes, np.tile(PUT_IN, (4, 1)), atol=3e-5)


def test_without_cycles_five_blocks_stand_in(run) -> None:
    recording = replace(run(), cycle=None, phase=None)
    slopes = block_slopes(recording, recording.linear_acceleration)
    assert slopes.shape == (5, 3)
    np.testing.assert_allclose(slopes.mean(axis=0), PUT_IN, atol=3e-5)


def test_a_single_temperature_gives_no_slope(run) -> None:
    recording = run()
    recording = replace(recording, temperature=np.full(len(recording), 20.0))
    assert block_slopes(recording, recording.linear_acceleration).shape == (0, 3)


def test_orientation_is_found_where_it_matters_only(run) -> None:
    same, different = {}, {}
    for i, up in enumerate('xyz'):
        recording = run(up=up, seed=10 + i)
        same[up] = block_slopes(recording, recording.linear_acceleration)
        scale = 1e-4 * (recording.temperature - 20.0)[:, None] * np.eye(3)[i] * 9.81
        different[up] = block_slopes(recording, recording.linear_acceleration + scale)
    assert (compare_orientations(same).p_value > 0.001).all()
    found = compare_orientations(different)
    assert (found.p_value < 1e-6).all()
    np.testing.assert_allclose(found.difference, 9.81e-4, rtol=0.1)
    assert compare_orientations({'x': same['x']}) is None


def test_devices_of_opposite_slope_are_not_compatible(run) -> None:
    slopes = {
        name: np.concatenate(
            [
                block_slopes(r, r.magnetic_field)
                for r in (run(name, seed=seed), run(name, seed=seed + 1))
            ]
        )
        for name, seed in (('dut1', 1), ('dut2', 3), ('dut3', 5))
    }
    pairs = {pair.devices: pair for pair in compare_devices(slopes)}
    assert pairs['dut1', 'dut2'].normalised_difference == pytest.approx(
        pairs['dut1', 'dut2'].normalised_difference.clip(10.0)
    )
    assert pairs['dut1', 'dut2'].opposite.all()
    assert (pairs['dut1', 'dut3'].normalised_difference < 2.0).all()
    assert not pairs['dut1', 'dut3'].opposite.any()
