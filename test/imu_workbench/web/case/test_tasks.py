# SPDX-License-Identifier: Apache-2.0
"""Tasks of the workers: bags stored, runs prepared, effects added and taken out."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np
import pytest
from imu_workbench.web.case.tasks import (
    Change,
    change_task,
    load_runs,
    prepare_task,
    version_task,
)
from thermal_comp.data.preparation import prepare
from thermal_comp.model.values import ModelError

from imu_recording import read_bag


def test_a_stored_bag_gives_the_recording_back(fitted):
    bag = fitted.bags[1]
    stored, read = bag.recording(), read_bag(bag.source)
    assert (stored.device, stored.up_axis, stored.notes) == (
        read.device, read.up_axis, read.notes,
    )  # fmt: skip
    for name in ('stamp', 'linear_acceleration', 'magnetic_field', 'humidity', 'phase'):
        assert np.array_equal(getattr(stored, name), getattr(read, name), equal_nan=True), name


def test_runs_have_no_file_until_it_is_whole(fitted, tmp_path, monkeypatch):
    def write_half(_: object, file: BinaryIO, **_options: object) -> None:
        file.write(b'half')
        raise KeyboardInterrupt

    target = tmp_path / 'prepared.runs'
    monkeypatch.setattr('pickle.dump', write_half)
    with pytest.raises(KeyboardInterrupt):
        prepare_task(fitted.progress, fitted.bags[:1], target)
    assert not target.exists()


def test_runs_are_prepared_as_one_campaign(fitted):
    ours = load_runs(fitted.prepared)
    recordings = [bag.recording() for bag in fitted.bags]
    for own, run in zip(ours, prepare(recordings), strict=True):
        assert own.conditions.time_before == run.conditions.time_before
        assert np.array_equal(own.conditions.hard_iron, run.conditions.hard_iron, equal_nan=True)
    assert ours[2].conditions.time_before > 3600.0


def test_adding_reaches_the_floor_and_taking_out_brings_the_error_back(fitted):
    assert fitted.line.error('accelerometer') > 5.0 * fitted.line.floor('accelerometer')
    assert fitted.lag.error('accelerometer') <= 1.05 * fitted.lag.floor('accelerometer')
    assert 'thermal_lag' in fitted.lag.effects['accelerometer']
    change = Change('thermal_lag', added=False)
    back = change_task(lambda _: None, fitted.prepared, fitted.lag.model_text, change, [])
    assert back.error('accelerometer') == pytest.approx(
        fitted.line.error('accelerometer'), rel=1e-6
    )


@pytest.mark.long
def test_a_campaign_effect_takes_its_part_out_of_the_residual(fitted):
    change = Change('bias_drift', ('gyroscope',))
    version = change_task(lambda _: None, fitted.prepared, fitted.line.model_text, change, [])
    part = version.comparison['sensors']['gyroscope']
    residual = np.concatenate([run.residual('gyroscope') for run in version.blocks])
    # The noise that weights the campaign effect may be another: three digits are shown.
    assert np.sqrt(np.nanmean(residual**2, axis=0)) == pytest.approx(
        part['residual_rms'], rel=5e-3
    )


def test_the_model_of_another_device_is_refused(fitted):
    text = fitted.line.model_text.replace('device: dut2', 'device: dut9', 1)
    with pytest.raises(ModelError, match='dut9'):
        version_task(lambda _: None, fitted.prepared, text, 'opened', [])
