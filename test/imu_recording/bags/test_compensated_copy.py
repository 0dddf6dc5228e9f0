# SPDX-License-Identifier: Apache-2.0
"""A bag with compensated measurements beside its own: nothing of the source is changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_recording.bags.compensated_copy import write_compensated_copy
from recording_samples import assert_same, make_recording

from imu_recording import BagError, ImuRecording, read_bag, write_bag

RAW = {'imu/data_raw': 'imu/data_raw', 'imu/mag': 'imu/mag'}


@pytest.fixture
def source(tmp_path: Path) -> Path:
    write_bag(make_recording(60), tmp_path / 'source')
    return tmp_path / 'source'


def shifted(source: Path, by: float, model: str) -> ImuRecording:
    recording = read_bag(source)
    return replace(
        recording,
        angular_velocity=recording.angular_velocity + by,
        magnetic_field=2.0 * recording.magnetic_field,
        compensated=model,
    )


def test_both_are_read_back_bit_by_bit(source: Path, tmp_path: Path) -> None:
    compensated = shifted(source, 1.0, 'model A')
    write_compensated_copy(compensated, source, tmp_path / 'copy')
    assert_same(read_bag(tmp_path / 'copy', remap=RAW), read_bag(source))
    back = read_bag(tmp_path / 'copy')
    assert_same(back, compensated)
    assert back.compensated == 'model A'


def test_an_older_compensation_makes_way(source: Path, tmp_path: Path) -> None:
    write_compensated_copy(shifted(source, 1.0, 'model A'), source, tmp_path / 'first')
    again = shifted(source, 5.0, 'model B')
    write_compensated_copy(again, tmp_path / 'first', tmp_path / 'second', RAW)
    back = read_bag(tmp_path / 'second')
    assert back.compensated == 'model B'
    np.testing.assert_array_equal(back.angular_velocity, again.angular_velocity)
    assert_same(read_bag(tmp_path / 'second', remap=RAW), read_bag(source))


def test_what_was_not_measured_stays_missing(source: Path, tmp_path: Path) -> None:
    write_compensated_copy(shifted(source, 1.0, 'm'), source, tmp_path / 'copy')
    missing = np.isnan(read_bag(source).magnetic_field)
    assert missing.any()
    np.testing.assert_array_equal(np.isnan(read_bag(tmp_path / 'copy').magnetic_field), missing)


def test_nothing_is_overwritten(source: Path) -> None:
    with pytest.raises(BagError, match='exists already; remove it or name another'):
        write_compensated_copy(shifted(source, 1.0, 'm'), source, source)
