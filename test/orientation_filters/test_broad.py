# SPDX-License-Identifier: Apache-2.0
"""Real motion with optical truth (BROAD): the errors of the presets on four of the trials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from orientation_filters.errors import attitude_errors
from orientation_filters.filters import run_filter
from scipy.io import loadmat

LIMITS_DEG = {
    '01_undisturbed_slow_rotation_A': {'ahrs paper': 3.0, 'ahrs robust': 2.0},
    '15_undisturbed_fast_translation_A': {'ahrs robust': 2.9, 'complementary robust': 2.9},
    '28_disturbed_stationary_magnet_A': {'ahrs robust': 4.0, 'complementary robust': 4.0},
    '36_disturbed_attached_magnet_5cm': {'ahrs robust': 4.2, 'complementary robust': 4.2},
}
"""VQF's error on 28; on 15 and 36 a tenth and a fifth above what was measured, 2.3° and 2.4° being
VQF's; 01 as claimed."""


@pytest.mark.shared_data
@pytest.mark.parametrize('trial', LIMITS_DEG)
def test_errors_on_real_motion(shared: Path, trial: str) -> None:
    data = loadmat(shared / 'data' / 'broad' / f'{trial}.mat')
    n = len(data['imu_gyr'])
    recording = ImuRecording(
        stamp=np.round(np.arange(n) * (1e9 * 7 / 2000)).astype(np.int64),
        angular_velocity=data['imu_gyr'],
        linear_acceleration=data['imu_acc'],
        magnetic_field=data['imu_mag'] * 1e-6,
        temperature=np.full(n, np.nan),
    )
    truth = data['opt_quat'][:, [1, 2, 3, 0]]
    rows = data['movement'].ravel().astype(bool)
    for label, limit in LIMITS_DEG[trial].items():
        name, preset = label.split()
        q = run_filter(name, recording, preset=preset).orientation
        assert np.degrees(attitude_errors(q, truth).rms(rows)['total']) < limit, label
