# SPDX-License-Identifier: Apache-2.0
"""Three runs of a device whose slopes are known, and its certificate."""

from pathlib import Path

import pytest
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.laboratory import read_laboratory
from imu_workbench.report.limits import CoefficientLimit, CoefficientLimits

from .certificates import content_of

EXAMPLE = Path(__file__).resolve().parents[4] / 'examples' / 'laboratory.yaml'


@pytest.fixture(scope='module')
def analysis(run):
    recordings = [run('dut1', up, seed=i, cycles=3) for i, up in enumerate('xyz')]
    return analyse_recordings(recordings, attitudes=False, diagnosis=False)


@pytest.fixture(scope='module')
def content(analysis):
    limits = CoefficientLimits({'gyroscope': {'slope': CoefficientLimit(-3e-5, 3e-5, 'rad/s/K')}})
    return content_of(analysis, laboratory=read_laboratory(EXAMPLE), limits=limits)


@pytest.fixture(scope='module')
def certificate(content):
    return content['certificates']['dut1']
