# SPDX-License-Identifier: Apache-2.0
"""report: the model it is given, and a measured recording from CSV to page."""

import json
from pathlib import Path

import pytest
from imu_workbench.__main__ import main

ROOT = Path(__file__).resolve().parents[3]


def test_a_report_uses_the_model_it_is_given(
    device_bags: Path, dut1_model: Path, tmp_path: Path
) -> None:
    argv = ['report', str(device_bags / 'dut1'), '--no-attitude', '-o', str(tmp_path / 'r.html')]
    assert main([*argv, '--model', str(dut1_model)]) == 0
    assert main([*argv, '--model', str(dut1_model), '--model', str(dut1_model)]) == 2
    other = [*argv[:1], str(device_bags / 'dut2'), *argv[2:]]
    assert main([*other, '--model', str(dut1_model)]) == 2


@pytest.mark.long
@pytest.mark.shared_data
def test_a_measured_recording_goes_all_the_way(shared: Path, tmp_path: Path) -> None:
    bag, target = tmp_path / 'freeimu', tmp_path / 'm.yaml'
    csv = shared / 'data/freeimu_freezer/Tempdata01-02-14.csv'
    mapping = ROOT / 'examples/freeimu_mapping.yaml'
    assert main(['import', str(csv), '--mapping', str(mapping), '-o', str(bag)]) == 0
    assert main(['fit', str(bag), '-o', str(target)]) == 0
    page, answer = tmp_path / 'r.html', tmp_path / 'r.json'
    argv = ['report', str(bag), '--model', str(target), '-o', str(page), '--json', str(answer)]
    assert main(argv) == 0
    content = json.loads(answer.read_text())
    gyroscope = content['comparison']['freeimu']['sensors']['gyroscope']
    # The board's y gyroscope drifts 0.35 °/s over 18 K; a line takes most of that away.
    assert gyroscope['residual_rms'][1] < 0.1 * gyroscope['measured_rms'][1]
    assert content['recordings'][0]['plan']['phases'] == []
