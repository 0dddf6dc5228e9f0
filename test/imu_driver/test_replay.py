# SPDX-License-Identifier: Apache-2.0
"""A bag instead of a device: its rows as samples, and URLs that are refused."""

from dataclasses import replace

import numpy as np
import pytest
from imu_driver.replay import BagReader, recorded_samples

from imu_recording import ImuRecording

SECOND = 1_000_000_000
RECORDING = ImuRecording(
    stamp=1_700_000_000 * SECOND + np.arange(25) * SECOND // 10,
    angular_velocity=np.ones((25, 3)),
    linear_acceleration=np.ones((25, 3)),
    magnetic_field=np.where(np.arange(25)[:, None] % 5 == 0, 1e-5, np.nan) * np.ones(3),
    temperature=np.array([np.nan] * 3 + [20.0] * 12 + [20.5] * 10),
)


def test_a_held_temperature_is_a_sample_where_it_changes_and_once_a_second() -> None:
    samples = list(recorded_samples(RECORDING))
    assert [s.stamp for s in samples] == RECORDING.stamp.tolist()
    measured = {k: s.temperature for k, s in enumerate(samples) if s.temperature is not None}
    assert measured == {3: 20.0, 13: 20.0, 15: 20.5}
    assert [k for k, s in enumerate(samples) if s.magnetic_field] == [0, 5, 10, 15, 20]


def test_stamps_of_the_temperature_tell_its_samples() -> None:
    measured = RECORDING.stamp // SECOND * SECOND
    samples = recorded_samples(replace(RECORDING, temperature_stamp=measured))
    rows = [k for k, s in enumerate(samples) if s.temperature is not None]
    assert rows == [10, 20]


@pytest.mark.parametrize(
    ('url', 'told'),
    [
        ('bag://x?pace=2', 'unknown option pace; known: rate, namespace'),
        ('bag://x?rate=fast', 'rate must be a number'),
        ('bag:///nowhere', '/nowhere'),
    ],
)
def test_urls_that_are_refused(url: str, told: str) -> None:
    with pytest.raises((ValueError, OSError), match=told):
        BagReader(url, deliver=lambda _: None, report=lambda _: None)
