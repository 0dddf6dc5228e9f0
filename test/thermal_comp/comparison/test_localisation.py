# SPDX-License-Identifier: Apache-2.0
"""Where residuals are large is found: by phase, cycle, branch and temperature, in noise floors."""

import numpy as np
import pytest
from imu_recording.recording import PHASES
from thermal_comp.comparison.localisation import LEAST_BLOCKS_IN_GROUP, branches, rank_where
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun

from ..campaign import run

FLOOR = np.array([1e-4, 2e-4, 5e-5])


@pytest.fixture(scope='module')
def prepared() -> PreparedRun:
    return prepare([run('+z', seed=3)])[0]


def test_the_group_that_is_off_comes_first_with_its_size(prepared: PreparedRun) -> None:
    hot = prepared.phase == PHASES.index('dwell_hot')
    residual = np.where(hot[:, None], 3.0, 1.0) * FLOOR
    worst = rank_where([prepared], [residual], FLOOR)[0]
    assert worst.group['phase'] == 'dwell_hot'
    assert worst.ratio == pytest.approx(3.0)
    np.testing.assert_allclose(worst.rms, 3.0 * FLOOR)


def test_an_axis_without_noise_does_not_count(prepared: PreparedRun) -> None:
    residual = np.ones((len(prepared), 3)) * [*FLOOR[:2], 1.0]
    floor = np.array([*FLOOR[:2], 0.0])
    for where in rank_where([prepared], [residual], floor):
        assert where.ratio == pytest.approx(np.sqrt(2.0 / 3.0))


def test_blocks_without_a_value_belong_to_no_group(prepared: PreparedRun) -> None:
    residual = np.full((len(prepared), 3), np.nan)
    residual[: LEAST_BLOCKS_IN_GROUP - 1] = FLOOR
    assert rank_where([prepared], [residual], FLOOR) == ()


def test_branches_are_those_of_the_ramps(prepared: PreparedRun) -> None:
    branch = branches(prepared)
    up, down = (prepared.phase == PHASES.index(name) for name in ('ramp_up', 'ramp_down'))
    assert (branch[up] == 1).mean() > 0.9  # where a ramp begins the die still follows the last
    assert (branch[down] == -1).mean() > 0.9
    assert {-1, 0, 1} == set(branch.tolist())
