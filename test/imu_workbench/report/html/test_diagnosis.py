# SPDX-License-Identifier: Apache-2.0
"""A shape parameter has one value on the page of a diagnosis."""

from __future__ import annotations

from imu_workbench.report.html.diagnosis import diagnosis_values


def test_a_shape_parameter_has_one_value_in_a_report_and_says_what_its_width_is() -> None:
    width = {'value': 3.19, 'std': 0.14, 'unit': 'K'}
    finding = {
        'kind': 'effect', 'name': 'thermal_hysteresis', 'sensor': 'gyroscope', 'rivals': [],
        'text': '', 'evidence': 90.0, 'threshold': 11.0, 'probability': 0.99,
        'error_after': None, 'parameters': {'half_width': width},
    }  # fmt: skip
    found = {'device': 'dut1', 'verdict': 'missing', 'greyed_out': {}, 'undetermined': [],
             'findings': [finding]}  # fmt: skip
    own = {'effect': 'thermal_hysteresis', 'parameter': 'half_width', 'unit': 'K', 'std': 0.135}
    certified = [own | {'sensor': 'gyroscope', 'value': 3.2},
                 own | {'sensor': 'magnetometer', 'value': 9.0}]  # fmt: skip
    for shapes, said in (((), '3.19 ± 0.14'), (certified, '3.20 ± 0.14')):
        detail = diagnosis_values(found, shapes)['findings'][0]['detail']
        assert detail.endswith(f'half width = {said} K (± one standard deviation)')
