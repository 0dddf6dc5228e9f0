# SPDX-License-Identifier: Apache-2.0
"""A finding's line names the threshold where there is one, and none where there is not."""

import pytest
from imu_workbench.diagnosis_text import diagnosis_text
from thermal_comp.diagnose_result import Diagnosis, Finding


@pytest.mark.parametrize(
    ('threshold', 'weight'), [(0.0, '(evidence 260)'), (25.0, '(evidence 260, needed 25)')]
)
def test_only_a_real_threshold_is_named(threshold: float, weight: str) -> None:
    text = 'run x: 26 of 900 rows'
    finding = Finding('data_quality', 'stuck_value', 'gyroscope', 260.0, threshold, text=text)
    lines = diagnosis_text(Diagnosis('dut1', (finding,), {}, {}, (), ()).content()).splitlines()
    assert lines[1] == f'  {text} {weight}'
