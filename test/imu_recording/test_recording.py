# SPDX-License-Identifier: Apache-2.0
"""A recording keeps its columns together and refuses others; its hash is of what was measured."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import columns_hash, infer_up_axis
from recording_samples import arrays, make_recording

from imu_recording import ImuRecording, RecordingError


def test_rows_take_every_track_alike() -> None:
    recording = make_recording(50)
    chosen = np.arange(50) % 3 == 1
    for selection in (chosen, slice(5, 20, 2), np.array([3, 7, 30])):
        part = recording.rows(selection)
        whole = arrays(recording)
        assert sorted(arrays(part)) == sorted(whole)
        for name, column in arrays(part).items():
            assert np.array_equal(column, whole[name][selection], equal_nan=True), name
    assert part.device == recording.device


def test_a_summary_is_plain_and_shows_as_a_table() -> None:
    recording = replace(make_recording(50), device='<a & b>', run='')
    told = recording.to_dict()
    assert json.loads(json.dumps(told)) == told
    assert (told['device'], told['rows']) == ('<a & b>', 50)
    assert told['duration_s'] == recording.time[-1]
    assert told['rate_hz'] == pytest.approx(49 / recording.time[-1])
    assert 'setpoint' in told['channels']
    assert 'setpoint' not in replace(recording, setpoint=None).to_dict()['channels']
    page = recording._repr_html_()
    assert page.count('<tr>') == len(told)
    assert '&lt;a &amp; b&gt;' in page
    assert '<th>run</th><td>–</td>' in page
    empty = recording.rows(slice(0, 0))
    assert (empty.to_dict()['duration_s'], empty.to_dict()['rate_hz']) == (0.0, None)
    assert '<th>rate_hz</th><td>–</td>' in empty._repr_html_()


def test_time_is_exact_where_epoch_seconds_are_not() -> None:
    recording = make_recording(3, step_ns=1)
    assert recording.time.tolist() == [0.0, 1e-9, 2e-9]
    assert recording.rows(slice(0, 0)).time.shape == (0,)


def test_wrong_shapes_and_axes_are_refused() -> None:
    recording = make_recording(4)
    with pytest.raises(RecordingError, match=r'temperature has shape \(3,\), expected \(4,\)'):
        replace(recording, temperature=np.zeros(3))
    with pytest.raises(RecordingError, match=r'vibration has shape \(4, 2\), expected \(4, 3\)'):
        replace(recording, vibration=np.zeros((4, 2)))
    with pytest.raises(RecordingError, match="up_axis 'up' is none of"):
        replace(recording, up_axis='up')


def test_notes_are_added() -> None:
    assert make_recording(2).with_notes('a').with_notes('b', 'c').notes == ('a', 'b', 'c')


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('sign', [1, -1])
def test_gravity_tells_the_up_axis(axis: int, sign: int) -> None:
    rng = np.random.default_rng(axis)
    force = rng.normal(0, 0.3, (500, 3))
    force[:, axis] += sign * 9.8
    force[7] = np.nan
    assert infer_up_axis(force) == f'{"+" if sign > 0 else "-"}{"xyz"[axis]}'


def test_an_axis_without_a_value_hides_no_gravity_on_another() -> None:
    force = np.tile([0.1, np.nan, -9.8], (50, 1))
    assert infer_up_axis(force) == '-z'
    assert infer_up_axis(force[:, [0, 2, 1]]) == '-y'
    assert infer_up_axis(np.tile([0.1, 0.2, np.nan], (50, 1))) == ''


def test_no_up_axis_where_gravity_does_not_tell() -> None:
    tilted = np.tile([6.9, 0.0, 6.9], (100, 1))
    turning = np.repeat([[9.8, 0, 0], [0, 9.8, 0]], 50, axis=0)
    in_counts = np.tile([0.0, 0.0, 16384.0], (100, 1))
    for force in (tilted, turning, in_counts, np.zeros((5, 3)), np.full((5, 3), np.nan)):
        assert infer_up_axis(force) == ''


def measured() -> ImuRecording:
    n = 50
    rng = np.random.default_rng(2)
    return ImuRecording(
        np.arange(n) * 10**9,
        rng.standard_normal((n, 3)),
        rng.standard_normal((n, 3)),
        rng.standard_normal((n, 3)),
        np.linspace(0.0, 1.0, n),
        supply_voltage=np.full(n, 3.3),
    )


def test_the_hash_is_not_of_names_paths_and_memory_layout() -> None:
    plain = measured()
    turned = np.asfortranarray(plain.angular_velocity)
    other = replace(plain, angular_velocity=turned, device='x', source='elsewhere', notes=('z',))
    assert columns_hash(other) == columns_hash(plain)
    assert len(columns_hash(plain)) == 64


def test_the_hash_is_of_every_value_and_every_track() -> None:
    plain = measured()
    changed = plain.magnetic_field.copy()
    changed[7, 2] = np.nextafter(changed[7, 2], 1.0)
    hashes = {
        columns_hash(item)
        for item in (
            plain,
            replace(plain, magnetic_field=changed),
            replace(plain, supply_voltage=None),
            replace(plain, supply_voltage=None, humidity=plain.supply_voltage),
            plain.rows(slice(0, 49)),
        )
    }
    assert len(hashes) == 5


def test_every_nan_has_the_same_hash() -> None:
    plain = measured()
    one, other = plain.temperature.copy(), plain.temperature.copy()
    one[3] = np.nan
    other.view(np.int64)[3] = 0x7FF8000000000123
    assert np.isnan(other[3])
    assert columns_hash(replace(plain, temperature=one)) == columns_hash(
        replace(plain, temperature=other)
    )
