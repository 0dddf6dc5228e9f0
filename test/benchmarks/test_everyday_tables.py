# SPDX-License-Identifier: Apache-2.0
"""Scores of answers whose quality is known."""

import numpy as np
import pytest
from everyday_scores import (
    calibration_error,
    error_ratios,
    errors_if_calibrated,
    groups,
    hypotheses,
    shift,
)
from everyday_tables import tables

ALL = {'accelerometer': {}, 'gyroscope': {}, 'magnetometer': {}}


def effect(name, sensor='accelerometer', magnitude=5.0, *, listed=True, logged=True):
    return {
        'name': name,
        'sensors': [sensor],
        'magnitude': magnitude,
        'parameters': {},
        'in_catalogue': listed,
        'logged': logged,
    }


def row(effects, explanations, **truth):
    said = [
        {'names': names, 'sensor': sensor, 'probability': p, 'approximate': False}
        for sensor, names, p in explanations
    ]
    hidden = {'effects': effects, 'unlogged': False, 'scenario': 'full_lab'} | truth
    return {
        'seed': 1,
        'kind': 'full_lab',
        'truth': hidden,
        'findings': [],
        'sensors': ALL,
        'explanations': said,
        'cpu_s': {},
    }


def right(effects, names, **truth):
    (one,) = (
        group
        for group in groups(row(effects, [('accelerometer', names, 1.0)], **truth))
        if 'accelerometer' in group.sensors
    )
    return one.right(one.sets[0][0])


def test_only_the_whole_set_of_names_is_right():
    two = [effect('thermal_lag'), effect('warm_up')]
    assert right(two, ['warm_up', 'thermal_lag'])
    assert not right(two, ['thermal_lag'])
    assert not right([effect('thermal_lag')], ['thermal_lag', 'warm_up'])
    assert right([effect('thermal_lag', 'gyroscope')], ['nothing'])


def test_laws_outside_and_unlogged_channels_have_answers_of_their_own():
    assert right([effect('rate_squared', listed=False)], ['not_in_catalogue'])
    assert right([effect('supply_sensitivity', logged=False)], ['unlogged'])
    assert not right([effect('supply_sensitivity')], ['unlogged'])


def test_lag_of_the_thermometer_may_be_named():
    assert not right([], ['thermal_lag'])
    assert right([], ['thermal_lag'], thermometer_magnitude={'accelerometer': 2.0})
    assert right([], ['nothing'], thermometer_magnitude={'accelerometer': 2.0})


def test_what_the_thermometer_makes_alike_is_one_hypothesis():
    said = [('accelerometer', ['nothing'], 0.7), ('accelerometer', ['thermal_lag'], 0.2)]
    said.append(('accelerometer', ['thermal_lag', 'bias_step'], 0.1))
    (group,) = [
        g
        for g in groups(row([], said, thermometer_magnitude={'accelerometer': 2.0}))
        if g.sensors == ('accelerometer',)
    ]
    found = {tuple(names): p for names, p in group.sets}
    assert found == {('nothing',): pytest.approx(0.9), ('bias_step',): pytest.approx(0.1)}


def test_answers_drawn_from_their_probabilities_are_calibrated():
    rng = np.random.default_rng(1)
    rows = []
    for p in rng.uniform(0.0, 1.0, 3000):
        hidden = 'warm_up' if rng.random() < p else 'bias_creep'
        said = [('accelerometer', ['warm_up'], p), ('accelerometer', ['bias_creep'], 1.0 - p)]
        said += [(sensor, ['nothing'], 1.0) for sensor in ('gyroscope', 'magnetometer')]
        rows.append(row([effect(hidden)], said))
    assert calibration_error(hypotheses(rows)) < 0.02
    credible = [any(map(g.right, g.credible)) for one in rows for g in groups(one)]
    assert np.mean(credible) >= 0.95


def test_answers_surer_than_they_may_be_are_not():
    hidden = [[effect('warm_up')], [effect('bias_creep')]] * 10
    rows = [row(one, [('accelerometer', ['warm_up'], 0.9)]) for one in hidden]
    of_accelerometer = hypotheses(rows)[::3]
    assert calibration_error(of_accelerometer) == pytest.approx(0.4, abs=0.01)


def test_findings_without_probabilities_are_read_as_such():
    finding = {
        'kind': 'effect',
        'name': 'thermal_lag',
        'sensor': 'accelerometer',
        'ambiguous_with': ['temperature_rate'],
        'error_after': None,
        'parameters': {},
    }
    one = row([effect('thermal_lag')], []) | {'findings': [finding]}
    (group,) = (group for group in groups(one) if group.required)
    assert [(set(names), p) for names, p in group.sets] == [
        ({'thermal_lag'}, 0.475),
        ({'temperature_rate'}, 0.475),
    ]
    assert len(groups(one)) == 3


def test_shift_is_the_largest_change_of_a_probability():
    before = row([], [('accelerometer', ['nothing'], 0.9), ('accelerometer', ['warm_up'], 0.1)])
    after = row([], [('accelerometer', ['nothing'], 0.6), ('accelerometer', ['icing'], 0.4)])
    assert shift(before | {'without': after}) == pytest.approx(0.4)
    assert shift(before | {'without': before}) == 0.0


ERROR = {'error_before': 4.0, 'error_after': 3.0}


@pytest.mark.parametrize(
    'prediction',
    [
        {'gyroscope': ERROR},
        [{'sensor': 'accelerometer+gyroscope', **ERROR}],
        {'error_before': {'gyroscope': 4.0}, 'error_after': {'gyroscope': [3.0, 3.0, 3.0]}},
    ],
)
def test_error_of_the_correction_is_counted_in_errors_of_the_true_form(prediction):
    one = row([], []) | {'true_form': {'gyroscope': 2.0}, 'prediction': prediction}
    assert error_ratios([one]) == pytest.approx([1.5])


def test_tables_count_what_crashed():
    rows = [row([], []), {'seed': 2, 'kind': 'bursts', 'crash': 'diagnose: ZeroDivisionError'}]
    text = tables(rows)
    assert '2 campaigns, 1 of them crashed' in text
    assert 'P(nothing) > 0.5 on all sensors' in text


def test_answers_that_are_right_as_often_as_stated_have_an_error_by_chance():
    said = [('accelerometer', ['thermal_lag'], 0.7), ('accelerometer', ['warm_up'], 0.3)]
    one = row([effect('thermal_lag')], said)
    one['sensors'] = {'accelerometer': {}}
    few, many = (np.mean(errors_if_calibrated([one] * n)) for n in (4, 400))
    # n Bernoulli draws: mean |found − stated| = √(2 p (1 − p) / (π n)), in both of the bins.
    assert many == pytest.approx(np.sqrt(2.0 * 0.21 / (np.pi * 400)), rel=0.15)
    assert few > 5.0 * many
