# SPDX-License-Identifier: Apache-2.0
"""The verdict in one sentence, and the one thing to do next."""

from __future__ import annotations

import re
from copy import deepcopy
from typing import Any

import pytest
from imu_workbench.simulate.hidden_effect import find_truth
from imu_workbench.web.case.top_strip import smallest_found_html
from imu_workbench.web.case.verdict import (
    Action,
    data_alerts,
    next_action,
    smallest_sizes,
    verdict_sentence,
    what_would_be_found,
)
from thermal_comp.presentation.diagnosis import verdict_line

LAG = 'thermal_lag'
KNOWN = [LAG, 'thermal_gradient']


def changed(found: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """The diagnosis with its first finding changed."""
    diagnosis = deepcopy(found['diagnosis'])
    diagnosis['findings'][0] |= changes
    return diagnosis


def test_what_is_hidden_in_the_bundled_bags_is_named(bags, found):
    truth, _ = find_truth(bags)
    (finding,) = found['diagnosis']['findings']
    assert (finding['sensor'], finding['name']) == (truth['sensor'], truth['name'])


def test_the_verdict_says_where_it_fails_by_how_much_and_why(fitted, found):
    sentence = verdict_sentence(found['diagnosis'], fitted.line.errors())
    said = re.fullmatch(
        r'Accelerometer fails in ramps, (\d\.\d) × noise\. Thermal lag, (\d+\.\d+) ± (\d\.\d+) s, '
        r'explains it\.',
        sentence,
    )
    assert said, sentence
    ratio = fitted.line.error('accelerometer') / fitted.line.floor('accelerometer')
    assert float(said[1]) == pytest.approx(ratio, abs=0.05)
    finding = found['diagnosis']['findings'][0]['parameters']['time_constant']
    assert float(said[2]) == pytest.approx(finding['value'], abs=0.05)


def test_the_sensor_furthest_above_its_noise_comes_first_as_the_plots_do(fitted, found):
    both = deepcopy(found['diagnosis'])
    near = both['findings'][0] | {'sensor': 'gyroscope', 'evidence': 1e9}
    both['findings'].insert(0, near)
    sentence = verdict_sentence(both, fitted.line.errors())
    assert sentence.startswith('Accelerometer fails in ramps')
    assert sentence.endswith('The gyroscope lacks something, too.')
    assert next_action(both, KNOWN, KNOWN).sensors == ('accelerometer',)


def test_parameters_of_an_effect_with_several_are_told_apart(fitted, found):
    fast, slow = ({'value': v, 'std': s, 'unit': 's'} for v, s in ((74.9, 7.5), (1470.0, 1048.0)))
    stages = {'time_constant_fast': fast, 'time_constant_slow': slow}
    sentence = verdict_sentence(changed(found, parameters=stages), fitted.line.errors())
    assert 'lag (time constant fast 74.9 ± 7.5 s, time constant slow 1 500 ± 1 000 s)' in sentence


def test_rivals_lead_to_the_experiment_that_decides(fitted, found):
    rivals = changed(found, ambiguous_with=['thermal_gradient'])
    assert 'cannot tell which' in verdict_sentence(rivals, fitted.line.errors())
    action = next_action(rivals, KNOWN, KNOWN)
    assert (action.kind, action.rivals) == ('experiment', (LAG, 'thermal_gradient'))


def test_an_effect_that_helps_comes_next_before_one_that_does_not(fitted, found):
    useless = changed(found, error_after=2.0 * found['diagnosis']['findings'][0]['error_before'])
    assert next_action(useless, KNOWN, KNOWN) == Action(
        'look', 'Leave thermal lag out of the model: its correction raises the held-out error.'
    )
    useful = useless['findings'][0] | {'sensor': 'gyroscope', 'error_after': 0.0}
    both = useless | {'findings': [*useless['findings'], useful]}
    assert next_action(both, KNOWN, KNOWN) == Action('add', '', LAG, ('gyroscope',))


def test_what_is_probably_missing_and_too_little_to_say_is_no_nothing(fitted, found):
    doubt = {'sensor': 'gyroscope', 'names': ['nothing'], 'probability': 0.21, 'depends_on': None}
    complete = found['diagnosis'] | {
        'findings': [],
        'verdict': 'complete',
        'explanations': [doubt],
    }
    sentence = verdict_sentence(complete, fitted.lag.errors())
    assert sentence == (
        'Nothing is missing for certain; something may be in the gyroscope (79 %).'
    )
    assert verdict_line(complete).endswith('but something may be (gyroscope, 79 %)')


def test_an_error_of_the_thermometer_is_corrected_before_anything_is_certified(fitted, found):
    errors = {'noise_floor': 1e-4, 'error_before': 8e-4, 'error_after': 2e-4}
    gyroscope = {'terms': [LAG], 'empirical': True, **errors}
    late = found['diagnosis'] | {'findings': [], 'prediction': {'gyroscope': gyroscope}}
    assert verdict_sentence(late, fitted.line.errors()) == (
        'No effect is missing, but the thermometer errs: gyroscope 8.0 × noise.'
    )
    assert next_action(late, KNOWN, KNOWN) == Action('add', '', LAG, ('gyroscope',))


def test_what_was_not_logged_is_what_to_log_next(fitted, found):
    unlogged = changed(found, kind='unlogged', name=None, depends_on='heater')
    assert 'not logged: heater' in verdict_sentence(unlogged, fitted.line.errors())
    assert next_action(unlogged, KNOWN, KNOWN).text == 'Log chamber/heater and record again.'


def test_nothing_missing_names_what_would_have_been_found(fitted, found):
    complete = found['diagnosis'] | {'findings': []}
    assert verdict_sentence(complete, fitted.lag.errors()).startswith('Nothing is missing')
    assert what_would_be_found(found['diagnosis']) == {}
    smallest = what_would_be_found(complete)
    assert list(smallest) == sorted(smallest)
    assert list(smallest[LAG]) == ['gyroscope', 'magnetometer']  # the accelerometer lacked it
    gyroscope, magnetometer = smallest_sizes(complete).split(', ')
    assert gyroscope.split() == [
        min((r['gyroscope'] for r in smallest.values() if 'gyroscope' in r), key=float), '°/s',
    ]  # fmt: skip
    assert magnetometer.endswith(' µT')
    rows = smallest_found_html(smallest).split('<tr>')
    assert sum('Gyroscope [°/s]</th><th>Magnetometer [µT]' in row for row in rows) == 2
    lag = next(row for row in rows if 'thermal lag<' in row)
    assert re.search(r'<td>0\.000\d\d</td><td>0\.0\d+</td>', lag)
    assert next_action(complete, KNOWN, KNOWN) == Action('certificate')


def test_defects_of_the_data_come_with_what_to_do(found):
    spikes = changed(found, kind='data_quality', name='spikes', text='gyroscope: 3 spikes')
    alerts = data_alerts(spikes, ['dut2_x: the file ends early', 'dut2_x: the file ends early'])
    assert alerts == ['gyroscope: 3 spikes: check bus and cable', 'dut2_x: the file ends early']


def test_an_effect_that_leaves_most_of_the_error_explains_a_part(fitted, found):
    content = found['diagnosis']
    left = {'accelerometer': {'error_after': 0.006, 'noise_floor': 0.001}}
    assert 'explains it.' in verdict_sentence(content, fitted.line.errors())
    changed = verdict_sentence(content | {'prediction': left}, fitted.line.errors())
    assert 'explains part of it; 6.0 × noise would be left.' in changed
    left['accelerometer']['error_after'] = None  # too short to hold a part out
    assert 'explains it.' in verdict_sentence(content | {'prediction': left}, fitted.line.errors())
