# SPDX-License-Identifier: Apache-2.0
"""Tables III–V say what the samples say."""

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.report.measured import largest_range, segment_rows, segment_statistics


def test_reference_and_cycles_are_the_segments(run) -> None:
    recording = run(cycles=3)
    tables = segment_statistics(recording)
    assert [row.segment for row in tables['gyroscope']] == ['reference', 'R1', 'R2', 'R3']
    assert [row.samples for row in tables['gyroscope']] == [300, 900, 900, 900]


def test_numbers_are_those_of_the_samples(run) -> None:
    recording = run()
    row = segment_statistics(recording)['accelerometer'][2]
    values = recording.linear_acceleration[recording.cycle == 2]
    np.testing.assert_array_equal(row.minimum, values.min(axis=0))
    np.testing.assert_array_equal(row.maximum, values.max(axis=0))
    np.testing.assert_allclose(row.mean, values.mean(axis=0))
    np.testing.assert_allclose(row.std, values.std(axis=0, ddof=1))


def test_a_60_kelvin_cycle_spans_60_kelvin_times_the_slope(run) -> None:
    tables = segment_statistics(run())
    spread = tables['magnetometer'][1].maximum - tables['magnetometer'][1].minimum
    np.testing.assert_allclose(spread, 60 * np.array([2e-7, 1e-7, 3e-7]), rtol=0.15)


def test_samples_that_are_not_finite_do_not_count(run) -> None:
    recording = run()
    field = recording.magnetic_field.copy()
    field[::2] = np.nan
    field[1] = np.inf
    tables = segment_statistics(replace(recording, magnetic_field=field))
    assert tables['magnetometer'][0].samples == 149
    assert np.isfinite(tables['magnetometer'][0].maximum).all()


def test_a_recording_without_tracks_is_one_segment(run) -> None:
    recording = replace(run(), phase=None, cycle=None, magnetic_field=np.full((4080, 3), np.nan))
    tables = segment_statistics(recording)
    assert list(segment_rows(recording)) == ['whole run']
    assert tables['magnetometer'] == []
    assert np.isnan(largest_range(tables, 'magnetometer'))


def test_start_up_samples_can_be_left_out(run) -> None:
    recording = run()
    force = recording.linear_acceleration.copy()
    force[:10, 2] *= 0.53  # the paper's edge transient
    recording = replace(recording, linear_acceleration=force)
    kept = np.arange(len(recording)) >= 10
    assert largest_range(segment_statistics(recording), 'accelerometer') > 4.5
    trimmed = largest_range(segment_statistics(recording, kept), 'accelerometer')
    assert trimmed == pytest.approx(60 * 3e-3, rel=0.2)
