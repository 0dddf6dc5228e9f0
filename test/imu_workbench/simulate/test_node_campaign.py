# SPDX-License-Identifier: Apache-2.0
"""campaign: real nodes in lock-step; the bags hold what was asked for and nothing is lost."""

import json
from pathlib import Path

import numpy as np
import pytest
from chamber_profile.run.journal import read_journal
from imu_recording.recording import PHASES
from imu_workbench.__main__ import main

from imu_recording import bag_namespaces, read_bag


@pytest.fixture(scope='module')
def campaign(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('campaign') / 'out'
    answer = folder.parent / 'answer.json'
    options = ['--devices', '2', '--json', str(answer)]
    assert main(['campaign', 'short_20min', '-o', str(folder), *options]) == 0
    return folder


@pytest.mark.long
def test_the_folder_holds_one_bag_per_orientation_with_journal_and_profile(campaign) -> None:
    assert sorted(path.name for path in campaign.iterdir()) == ['x', 'y', 'z']
    answer = json.loads((campaign.parent / 'answer.json').read_text())
    assert [run['orientation'] for run in answer['runs']] == ['+x', '+y', '+z']
    for name in 'xyz':
        assert read_journal(campaign / name)[-1]['mode'] == 'DONE'
        assert (campaign / name / 'profile.yaml').is_file()
        assert len(list((campaign / name).glob('*.mcap'))) >= 8  # a file per phase


def test_each_bag_holds_every_device_in_its_orientation(campaign) -> None:
    for axis, name in enumerate('xyz'):
        assert bag_namespaces(campaign / name) == ['/dut1', '/dut2']
        recording = read_bag(campaign / name, namespace='/dut2')
        assert recording.simulated == 'imu_driver.simulation'
        assert recording.up_axis == f'+{name}'
        assert recording.profile == 'short_20min'
        assert recording.linear_acceleration.mean(axis=0).argmax() == axis
        np.testing.assert_allclose(np.diff(recording.time), 2.0, atol=1e-6)
        assert recording.time[-1] > 1200
        assert set(recording.phase[20:]) == set(range(len(PHASES)))
        assert np.isfinite(recording.magnetic_field).all()
        assert np.isfinite(recording.temperature).all()
        for track in ('chamber_temperature', 'chamber_temperature_2', 'device_temperature',
                      'setpoint', 'humidity', 'heater', 'compressor', 'fan'):  # fmt: skip
            assert np.isfinite(getattr(recording, track)[1:]).all()


def test_the_die_follows_the_chamber(campaign) -> None:
    recording = read_bag(campaign / 'x', namespace='/dut1')
    cold, hot = (
        recording.temperature[recording.phase == PHASES.index(name)][-5:].mean()
        for name in ('dwell_cold', 'dwell_hot')
    )
    assert 8.0 < hot - cold < 16.0  # 15 K in the air, less the lag of a short dwell
