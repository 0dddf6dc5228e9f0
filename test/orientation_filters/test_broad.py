# SPDX-License-Identifier: Apache-2.0
"""Real motion with optical truth (BROAD): what presets err by, and what they say of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.recording import FloatArray, ImuRecording
from orientation_filters.errors import attitude_errors, normalised_errors
from orientation_filters.filters import FILTERS, run_filter
from scipy.io import loadmat

LIMITS_DEG = {
    '01_undisturbed_slow_rotation_A': {'ahrs paper': 3.0, 'ahrs robust': 2.0},
    '15_undisturbed_fast_translation_A': {'ahrs robust': 2.9, 'complementary robust': 2.9},
    '28_disturbed_stationary_magnet_A': {'ahrs robust': 4.0, 'complementary robust': 4.0},
    '36_disturbed_attached_magnet_5cm': {'ahrs robust': 4.2, 'complementary robust': 4.2},
}
"""VQF's error on 28; on 15 and 36 a tenth and a fifth above what was measured, 2.3° and 2.4° being
VQF's; 01 as claimed."""


HONEST = ('06_undisturbed_fast_rotation_A', '21_undisturbed_fast_combined', *LIMITS_DEG)
"""Errors of `paper` there go from 2.5° to 107°."""
NEES, CHI2_95 = (0.25, 2.0), 7.815
"""Normalised squared error per degree of freedom; 95 % of chi-square with three degrees."""


def load(shared: Path, trial: str) -> tuple[ImuRecording, FloatArray, FloatArray]:
    """Return a trial, its true attitudes and where the device moves."""
    data = loadmat(shared / 'data' / 'broad' / f'{trial}.mat')
    n = len(data['imu_gyr'])
    recording = ImuRecording(
        stamp=np.round(np.arange(n) * (1e9 * 7 / 2000)).astype(np.int64),
        angular_velocity=data['imu_gyr'],
        linear_acceleration=data['imu_acc'],
        magnetic_field=data['imu_mag'] * 1e-6,
        temperature=np.full(n, np.nan),
    )
    return recording, data['opt_quat'][:, [1, 2, 3, 0]], data['movement'].ravel().astype(bool)


@pytest.mark.shared_data
@pytest.mark.parametrize('trial', LIMITS_DEG)
def test_errors_on_real_motion(shared: Path, trial: str) -> None:
    recording, truth, rows = load(shared, trial)
    for label, limit in LIMITS_DEG[trial].items():
        name, preset = label.split()
        q = run_filter(name, recording, preset=preset).orientation
        assert np.degrees(attitude_errors(q, truth).rms(rows)['total']) < limit, label


@pytest.mark.shared_data
@pytest.mark.parametrize('trial', HONEST)
@pytest.mark.parametrize('name', FILTERS)
def test_a_fixed_gain_claims_what_it_errs_by(shared: Path, trial: str, name: str) -> None:
    recording, truth, rows = load(shared, trial)
    result = run_filter(name, recording, preset='paper')
    squares = normalised_errors(result.orientation[rows], truth[rows], result.covariance[rows])
    squares = squares[np.isfinite(squares)]  # the cameras lost the device at times
    assert NEES[0] < squares.mean() / 3.0 < NEES[1]
    assert np.mean(squares < CHI2_95) > 0.85
