# SPDX-License-Identifier: Apache-2.0
"""The certificate of a device whose slopes are known."""

from imu_workbench.report.content import report_content

SLOPES = {
    'accelerometer': (2e-3, -1e-3, 3e-3),
    'gyroscope': (4e-5, -2e-5, 1e-5),
    'magnetometer': (2e-7, -1e-7, 3e-7),
}


def content_of(analysis, **options):
    """Return the content of the report that holds the certificate."""
    return report_content(analysis, commands=['report'], versions={}, **options)


def coefficients(certificate, name):
    """Return one coefficient of every sensor and axis."""
    return [q for q in certificate['quantities'] if q['coefficient'] == name]
