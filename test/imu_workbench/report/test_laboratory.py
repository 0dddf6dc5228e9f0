# SPDX-License-Identifier: Apache-2.0
"""The statements of a laboratory are read in SI; a mistake names its place."""

from pathlib import Path

import pytest
from imu_recording.user_error import UserError
from imu_workbench.report.laboratory import read_laboratory


def test_a_mistake_in_the_laboratory_file_names_its_place(tmp_path: Path) -> None:
    path = tmp_path / 'laboratory.yaml'
    path.write_text('thermometer: {expanded_uncertainty: -1}\n')
    with pytest.raises(UserError, match=r'thermometer.expanded_uncertainty: -1'):
        read_laboratory(path)
    path.write_text('field: {value: 48, unit: µT}\n')
    with pytest.raises(UserError, match='expanded_uncertainty'):
        read_laboratory(path)
    path.write_text('field: {value: 48, expanded_uncertainty: 0.4, unit: µT}\n')
    assert read_laboratory(path).field == pytest.approx((48e-6, 0.2e-6))
    path.write_text('operater: nobody\n')
    with pytest.raises(UserError, match='did you mean operator'):
        read_laboratory(path)
