# SPDX-License-Identifier: Apache-2.0
"""Recordings that do not name their device are told apart where their slopes do."""

from dataclasses import replace
from pathlib import Path

import pytest
from thermal_comp.data.device_identity import unnamed_warning
from thermal_comp.data.preparation import prepare

from imu_recording import read_bag


def warned(bags: Path, *names: str, device: str = '') -> str:
    recordings = [replace(read_bag(bags / name), device=device) for name in names]
    return unnamed_warning(prepare(recordings))


@pytest.mark.parametrize(
    'pair', [('dut1_x', 'dut2_x'), ('dut1_y', 'dut3_z'), ('dut2_z', 'dut3_x')]
)
def test_two_devices_look_like_two(bags: Path, pair: tuple[str, str]) -> None:
    said = warned(bags, *pair)
    assert 'look like two' in said
    assert 'fit each by itself' in said


@pytest.mark.parametrize('device', ['dut1', 'dut2', 'dut3'])
def test_one_device_in_three_orientations_is_taken_for_one(bags: Path, device: str) -> None:
    said = warned(bags, *(f'{device}_{axis}' for axis in 'xyz'))
    assert said.startswith('3 runs name no device and are taken to be of one')


def test_named_devices_and_single_runs_need_no_word(bags: Path) -> None:
    assert warned(bags, 'dut1_x', 'dut1_y', device='dut1') == ''
    assert warned(bags, 'dut1_x') == ''
