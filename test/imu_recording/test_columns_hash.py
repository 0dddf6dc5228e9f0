# SPDX-License-Identifier: Apache-2.0
"""The hash follows what was measured and nothing else."""

from dataclasses import replace

import numpy as np
from imu_recording.recording import columns_hash

from imu_recording import ImuRecording


def recording() -> ImuRecording:
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


def test_names_paths_and_memory_layout_do_not_count() -> None:
    plain = recording()
    turned = np.asfortranarray(plain.angular_velocity)
    other = replace(plain, angular_velocity=turned, device='x', source='elsewhere', notes=('z',))
    assert columns_hash(other) == columns_hash(plain)
    assert len(columns_hash(plain)) == 64


def test_every_value_and_every_track_counts() -> None:
    plain = recording()
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


def test_every_nan_is_the_same() -> None:
    plain = recording()
    one, other = plain.temperature.copy(), plain.temperature.copy()
    one[3] = np.nan
    other.view(np.int64)[3] = 0x7FF8000000000123
    assert np.isnan(other[3])
    assert columns_hash(replace(plain, temperature=one)) == columns_hash(
        replace(plain, temperature=other)
    )
