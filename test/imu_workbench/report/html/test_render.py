# SPDX-License-Identifier: Apache-2.0
"""Templates: every one compiles, every value is escaped, sections without data stay away."""

from __future__ import annotations

import numpy as np
import pytest
from imu_workbench.report.html.attitude import attitude_section
from imu_workbench.report.html.claims import reproduce_section
from imu_workbench.report.html.measured import cycle_section, plan_section
from imu_workbench.report.html.modelled import comparison_section, model_section
from imu_workbench.report.html.profile import timetable_section
from imu_workbench.report.html.render import Section, json_for_page, packed, render_page, templates


@pytest.mark.parametrize('name', sorted(templates().list_templates()))
def test_every_template_compiles(name: str) -> None:
    templates().get_template(name)


def test_values_are_escaped_wherever_they_stand() -> None:
    hostile = '<b onclick="x">&'
    step = {'id': hostile, 'cycle': 1, 'start_s': 0.0, 'duration_s': 60.0, 'from_c': 20.0,
            'to_c': 20.0}  # fmt: skip
    reproduce = reproduce_section(
        {
            'reproduce': {'commands': [hostile], 'versions': {hostile: hostile}},
            'recordings': [{'name': hostile, 'sha256': hostile}],
        }
    )
    page = render_page(hostile, hostile, [timetable_section({'steps': [step]}), reproduce])
    assert '<b onclick' not in page
    assert page.count('&lt;b onclick=&#34;x&#34;&gt;&amp;') >= 8


def test_a_missing_value_is_an_error_not_a_gap() -> None:
    with pytest.raises(Exception, match='undefined'):
        Section('plan', 'The plan', 'plan.html', {}).body()


def test_sections_without_data_stay_away() -> None:
    nothing = {'recordings': [], 'attitudes': [], 'comparison': {}, 'models': {}}
    for section in (
        plan_section, cycle_section, attitude_section, comparison_section, model_section,
    ):  # fmt: skip
        assert section(nothing) is None


def test_long_lists_are_packed_and_holes_survive() -> None:
    values = [0.0, None, *range(40)]
    spec = packed({'x': values, 'short': [1, 2]})
    numbers = np.frombuffer(__import__('base64').b64decode(spec['x']['bdata']), np.float32)
    assert np.isnan(numbers[1])
    assert numbers[-1] == 39
    assert spec['short'] == [1, 2]
    assert '</' not in json_for_page({'a': '</script>'})
