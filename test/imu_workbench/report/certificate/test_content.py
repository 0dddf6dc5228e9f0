# SPDX-License-Identifier: Apache-2.0
"""The certificate states what was put in, within its uncertainty, and invents nothing."""

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.user_error import UserError
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.html.certificate import budget_tables
from imu_workbench.report.html.document import report_page
from imu_workbench.report.laboratory import Laboratory
from imu_workbench.report.limits import CoefficientLimit, CoefficientLimits
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.scale_factor_temperature import ScaleFactorTemperature
from thermal_comp.fitting.fit import fit
from thermal_comp.presentation.display import coefficient_unit, shown, with_uncertainty

from .certificates import SLOPES, coefficients, content_of


def test_slopes_lie_within_their_uncertainty(certificate) -> None:
    for quantity in coefficients(certificate, 'slope'):
        truth = SLOPES[quantity['sensor']]['xyz'.index(quantity['axis'])]
        allowed = 1.5 * max(2.0, quantity['coverage_factor']) * quantity['combined']
        assert abs(quantity['value'] - truth) < allowed, quantity['sensor']
        assert quantity['combined'] < 0.05 * abs(truth)


def test_biases_are_those_of_axes_whose_input_is_known(certificate) -> None:
    found = coefficients(certificate, 'bias')
    assert {q['sensor'] for q in found} == {'accelerometer', 'gyroscope'}
    for quantity in found:
        assert abs(quantity['value']) < quantity['expanded']
    assert (
        'bias of the magnetometer: the field in the chamber is not known'
        in (certificate['not_determined'])
    )


def test_contributions_sum_to_the_combined_variance(certificate) -> None:
    for quantity in certificate['quantities']:
        total = sum(row['contribution'] ** 2 for row in quantity['rows'])
        assert total == pytest.approx(quantity['combined'] ** 2, rel=1e-9)
        assert quantity['monte_carlo'] == pytest.approx(quantity['combined'], rel=0.05)
        assert quantity['degrees'] is None or quantity['degrees'] >= 1.0


def test_limits_are_decided_with_the_uncertainty(certificate, content) -> None:
    decisions = {d['axis']: d['decision'] for d in certificate['decisions']}
    assert decisions == {'x': 'fail', 'y': 'pass', 'z': 'pass'}
    assert 'of 3 limits 2 kept, 1 not kept' in certificate['conclusion']
    assert 'NOT KEPT' in report_page(content)


def test_the_width_that_decided_stands_beside_the_decision(analysis) -> None:
    units = {'gyroscope': 'rad/s/K', 'accelerometer': 'm/s²/K', 'magnetometer': 'T/K'}
    bounds = {
        sensor: {'slope': CoefficientLimit(-1.0, 1.0, unit)} for sensor, unit in units.items()
    }
    guarded = content_of(analysis, limits=CoefficientLimits(bounds))
    found, page = guarded['certificates']['dut1'], report_page(guarded)
    decided = list(zip(found['decisions'], coefficients(found, 'slope'), strict=True))
    for decision, slope in decided:
        width = max(2.0, slope['coverage_factor']) * slope['combined']
        assert decision['deciding'] == pytest.approx(width)
        factor = coefficient_unit(slope['sensor'], slope['unit']).factor
        assert f'{decision["axis"]}: kept, w {shown(width * factor)}' in page
    assert any(d['deciding'] > 1.01 * slope['expanded'] for d, slope in decided)
    assert 'w is U, or k₉₅ · u where k₉₅ is above 2' in found['rule']
    simple = content_of(analysis, limits=CoefficientLimits(bounds, 'simple'))
    assert simple['certificates']['dut1']['decisions'][0]['deciding'] is None


def test_a_limit_without_a_result_is_named_and_a_wrong_unit_refused(analysis) -> None:
    absent = CoefficientLimits({'magnetometer': {'bias': CoefficientLimit(-1.0, 1.0, 'T')}})
    found = content_of(analysis, limits=absent)
    assert found['certificates']['dut1']['without_result'] == ['bias of the magnetometer']
    assert 'Limits without a result here: bias of the magnetometer' in report_page(found)
    wrong = CoefficientLimits({'gyroscope': {'slope': CoefficientLimit(-1.0, 1.0, 'rad/s')}})
    with pytest.raises(
        UserError, match=r'gyroscope\.slope is in rad/s, its coefficient in rad/s/K'
    ):
        content_of(analysis, limits=wrong)


@pytest.mark.long
def test_several_coefficients_of_an_effect_go_by_their_symbols_and_are_limited_together(
    run,
) -> None:
    recordings = [run('dut1', up, seed=i, cycles=3) for i, up in enumerate('xyz')]
    model = fit([BiasTemperature(), ScaleFactorTemperature()], recordings)
    analysis = analyse_recordings(recordings, {'dut1': model}, attitudes=False, diagnosis=False)
    limits = CoefficientLimits(
        {'accelerometer': {'scale_factor_temperature': CoefficientLimit(-1.0, 1.0, '1/K')}}
    )
    content = content_of(analysis, limits=limits)
    found, page = content['certificates']['dut1'], report_page(content)
    counted = [f'scale_factor_temperature, s_{axis}' for axis in 'xyz']
    assert [d['coefficient'] for d in found['decisions']] == counted
    assert all(coefficients(found, name) for name in counted)
    terms = [t for t in content['models']['dut1']['terms'] if t['effect'] in counted]
    for term in terms:
        text = with_uncertainty(1e6 * term['value'][0], 1e6 * term['uncertainty'][0])
        assert term['shared']
        assert f'<td colspan="3">{text}</td>' in page
    assert {t['effect'] for t in terms} == set(counted)
    assert 'Accelerometer: scale factor temperature, s_z' in page
    assert page.count('ppm/K') >= 9  # result, budget and model, an axis each
    assert '<td>1/K</td>' not in page
    assert 'rad/s/K' not in page
    assert found['equations']['scale_factor_temperature'].startswith('error_i = s_i · x · u_i')


def test_what_was_not_given_is_not_stated(analysis) -> None:
    content = content_of(analysis)
    found = content['certificates']['dut1']
    assert found['laboratory']['operator'] == 'not stated'
    assert found['device']['serial'] == 'not stated'
    assert found['laboratory']['thermometer']['uncertainty'] == 'not stated'
    slopes = 'accelerometer bias, slope; gyroscope bias, slope; magnetometer slope'
    assert f'thermometer calibration not stated ({slopes})' in found['not_included']
    assert not found['simulated']
    page = report_page(content)
    assert 'class="watermark"' not in page
    assert 'No limits of these coefficients were given' in page


def test_a_budget_has_a_word_for_what_does_not_count(analysis, certificate) -> None:
    def cells(found, sensor, name):
        table = next(t for t in budget_tables(found) if t['sensor'] == sensor)
        row = next(r for r in table['rows'] if r[0] == name)
        return dict(zip(table['head'][0], row, strict=True))

    nobody = content_of(analysis)['certificates']['dut1']
    slope = cells(nobody, 'Gyroscope', 'slope x')
    assert slope['thermometer calibration'] == 'not stated'
    assert slope['reference: Earth rate'] == '–'
    assert slope['noise'].endswith('%)')
    runs = [cells(nobody, s, 'slope x')['run to run'] for s in ('Gyroscope', 'Magnetometer')]
    assert all(text == '0' or text.endswith('%)') for text in runs)
    level = cells(nobody, 'Accelerometer', 'bias x')
    assert level['reference: tilt'] == 'not stated'
    assert cells(certificate, 'Accelerometer', 'bias x')['reference: tilt'].endswith('%)')
    assert cells(certificate, 'Accelerometer', 'slope x')['reference: tilt'] == '–'


def test_the_reference_stands_on_the_first_page(analysis, content) -> None:
    """What budgets count of gravity, mounting and field is what the laboratory stated."""
    first = report_page(content).partition('3 Recordings')[0]
    assert '9.8067 m/s²; uncertainty 0.0005 m/s² (k\u00a0=\u00a02); gravity map' in first
    assert 'tilt at most 0.3°' in first
    assert 'strength not stated; varies by at most 60 nT' in first
    assert 'by the thermocouple in the recordings' in first
    nobody = content_of(analysis)['certificates']['dut1']['laboratory']['references']
    assert [nobody[k] for k in ('gravity', 'mounting', 'magnetic field')] == ['not stated'] * 3
    field = {'value': 48.0, 'expanded_uncertainty': 0.4, 'unit': 'µT'}
    told = Laboratory({'field': field, 'gradient': {'half_width': 0.3, 'unit': 'K'}}).references()
    assert told['magnetic field'] == '48 µT; uncertainty 0.4 µT (k = 2)'
    assert told['gradient thermometer to die'] == 'at most 0.3 K'


def test_a_chamber_that_nobody_recorded_or_stated_is_not_told_of(run) -> None:
    logged = run('dut1', 'z', cycles=3)
    bare = replace(
        logged, profile='', setpoint=None, phase=None, cycle=None, chamber_temperature=None
    )
    said = {}
    for name, recording, told in (
        ('recorded', logged, {}), ('stated', bare, {'chamber': {'name': 'oven'}}),
        ('neither', bare, {}),
    ):  # fmt: skip
        analysis = analyse_recordings([recording], attitudes=False, diagnosis=False)
        found = content_of(analysis, laboratory=Laboratory(told))
        said[name] = found['certificates']['dut1']['method'][0]
        page = report_page(found)
        for words in ('Shaded: dwells', 'One cycle', 'The plan'):
            assert (words in page) == (recording is logged), words
    assert 'in a climatic chamber in 1 run, while the air was led through' in said['recorded']
    assert 'in a climatic chamber in 1 run, while its temperature changed' in said['stated']
    assert 'The device rested in 1 run, while its temperature changed' in said['neither']


def test_simulated_data_say_so(analysis, content) -> None:
    assert content['certificates']['dut1']['simulated']  # as the laboratory states
    assert 'class="watermark"' in report_page(content)
    runs = tuple(
        replace(run, recording=replace(run.recording, simulated='some simulator'))
        for run in analysis.runs
    )
    assert content_of(replace(analysis, runs=runs))['certificates']['dut1']['simulated']


def test_a_thermometer_adds_its_share_to_every_slope(analysis) -> None:
    def combined(expanded: float) -> float:
        stated = Laboratory({'thermometer': {'expanded_uncertainty': expanded}})
        found = content_of(analysis, laboratory=stated)['certificates']['dut1']
        return coefficients(found, 'slope')[0]['combined']

    span = np.ptp(analysis.certified['dut1'].model.sensors['gyroscope'].temperature_range)
    slope = coefficients(content_of(analysis)['certificates']['dut1'], 'slope')[0]['value']
    gained = combined(4.0) ** 2 - combined(2.0) ** 2
    assert gained == pytest.approx(2.0 * (slope / span) ** 2 * (2.0**2 - 1.0**2), rel=1e-6)


def test_the_paper_is_an_annex_of_its_campaigns_only(analysis, content) -> None:
    assert 'Claims of the paper' not in report_page(content)
    runs = tuple(
        replace(run, recording=replace(run.recording, profile='paper_betta2022'))
        for run in analysis.runs
    )
    assert 'Claims of the paper' in report_page(content_of(replace(analysis, runs=runs)))


def test_a_page_of_one_device_stays_below_five_megabytes(content) -> None:
    assert len(report_page(content).encode()) < 5e6
