# SPDX-License-Identifier: Apache-2.0
"""Templates: every one compiles, every value is escaped, sections without data stay away."""

from __future__ import annotations

import pytest
from imu_workbench.report.html.attitude import attitude_section
from imu_workbench.report.html.claims import reproduce_section
from imu_workbench.report.html.diagnosis import diagnosis_values
from imu_workbench.report.html.measured import cycle_section, notes, plan_section
from imu_workbench.report.html.modelled import comparison_section, model_section, slope_rows
from imu_workbench.report.html.profile import timetable_section
from imu_workbench.report.html.render import Section, render_page, templates


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


def test_a_note_of_every_run_is_told_once() -> None:
    runs = [{'name': name, 'notes': ['a gap'], 'unplaced': {}} for name in 'ab']
    assert notes({'recordings': runs}) == [{'text': 'a gap', 'runs': 'all 2 runs'}]
    runs[1] |= {'notes': [], 'unplaced': {'imu/mag': 1}}
    assert [note['runs'] for note in notes({'recordings': runs})] == ['a', 'b']


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


def test_slopes_are_shown_in_thousandths() -> None:
    slope = {'device': 'dut1', 'sensor': 'gyroscope', 'slope': [2e-3, None, 0.0], 'cycles': 4,
             'uncertainty': [1e-5, None, None]}  # fmt: skip
    assert slope_rows([slope], 'gyroscope') == [['dut1', '2.000 ± 0.010', '–', '0', '4']]
    assert slope_rows([slope], 'magnetometer') == []
