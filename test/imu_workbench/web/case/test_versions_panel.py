# SPDX-License-Identifier: Apache-2.0
"""The page's table of coefficients has the units of the certificate."""

from types import SimpleNamespace

from imu_workbench.web.case.versions_panel import coefficients_html


def test_coefficients_have_the_units_of_the_certificate() -> None:
    row = {'sensor': 'gyroscope', 'shared': False, 'value': [5.3e-4, 3.2e-4, 2.1e-4],
           'uncertainty': [4e-7] * 3, 'effect': 'bias_temperature', 'unit': 'rad/s/K'}  # fmt: skip
    scale = row | {'shared': True, 'effect': 'scale_factor_temperature', 'unit': '1/K'}
    table = coefficients_html(SimpleNamespace(coefficients=[row, scale], terms=[]), 'gyroscope')
    assert '<td>30.367 ± 0.023</td>' in table
    assert '<td>m°/s/K</td>' in table
    assert '<td colspan="3">530.00 ± 0.40</td><td>ppm/K</td>' in table
    assert 'rad/s/K' not in table
