# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import re

from imu_workbench.web.case.learn_page import (
    error_bars_html,
    evidence_text,
    finding_text,
)
from imu_workbench.web.case.version import parameter_text


def test_bars_grow_with_the_error_and_say_it_with_its_unit():
    errors = {'held-out error before': 0.1, 'held-out error after': 0.01, 'noise floor': 0.009}
    html = error_bars_html(errors, 'm/s²')
    widths = [int(width) for width in re.findall(r'width:(\d+)%', html)]
    assert widths[0] == 100
    assert widths == sorted(widths, reverse=True)
    assert '0.0100 m/s²' in html
    assert error_bars_html({'noise floor': None}, 'm/s²') == ''


def test_numbers_carry_their_uncertainty():
    assert parameter_text(79.41, 1.23) == '79.4 ± 1.2'
    assert parameter_text([1.0, 2.0], [0.1, 0.1]) == '1.00 ± 0.10, 2.00 ± 0.10'
    assert evidence_text(86_515.0, 15.0).endswith('(needed 15)')
    assert 'needed' not in evidence_text(3.0, 0.0)


def test_a_finding_names_effects_as_people_write_them():
    finding = {
        'text': 'thermal_lag or temperature_rate', 'name': 'thermal_lag',
        'ambiguous_with': ['temperature_rate'],
    }  # fmt: skip
    assert finding_text(finding) == 'thermal lag or temperature rate'
