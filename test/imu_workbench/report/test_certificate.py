# SPDX-License-Identifier: Apache-2.0
"""The certificate states what was put in, within its uncertainty, and invents nothing."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from imu_recording.user_error import UserError
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.certificate.budget import Input, Measurand, budget_of, scatter_inputs
from imu_workbench.report.certificate.conclusion import (
    approximate_forms,
    conclusion,
    still_missing,
)
from imu_workbench.report.certificate.recordings import conditions, losses, recording_row
from imu_workbench.report.content import report_content
from imu_workbench.report.html.certificate import budget_tables
from imu_workbench.report.html.document import report_page
from imu_workbench.report.laboratory import Laboratory, read_laboratory
from imu_workbench.report.limits import CoefficientLimit, CoefficientLimits
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.scale_factor_temperature import ScaleFactorTemperature
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.fitting.fit import fit
from thermal_comp.presentation.display import coefficient_unit, shown, with_uncertainty

EXAMPLE = Path(__file__).resolve().parents[3] / 'examples' / 'laboratory.yaml'
SLOPES = {
    'accelerometer': (2e-3, -1e-3, 3e-3),
    'gyroscope': (4e-5, -2e-5, 1e-5),
    'magnetometer': (2e-7, -1e-7, 3e-7),
}


@pytest.fixture(scope='module')
def analysis(run):
    recordings = [run('dut1', up, seed=i, cycles=3) for i, up in enumerate('xyz')]
    return analyse_recordings(recordings, attitudes=False, diagnosis=False)


def content_of(analysis, **options):
    return report_content(analysis, commands=['report'], versions={}, **options)


@pytest.fixture(scope='module')
def content(analysis):
    limits = CoefficientLimits({'gyroscope': {'slope': CoefficientLimit(-3e-5, 3e-5, 'rad/s/K')}})
    return content_of(analysis, laboratory=read_laboratory(EXAMPLE), limits=limits)


@pytest.fixture(scope='module')
def certificate(content):
    return content['certificates']['dut1']


def coefficients(certificate, name):
    return [q for q in certificate['quantities'] if q['coefficient'] == name]


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


@pytest.mark.parametrize('approximate', [False, True])
def test_a_form_is_called_approximate_where_the_diagnosis_says_so(analysis, approximate) -> None:
    certified = replace(analysis.certified['dut1'], added=('bias_temperature (accelerometer)',))
    explained = {
        'sensor': 'accelerometer',
        'names': ['bias_temperature'],
        'approximate': approximate,
    }
    rival = {'sensor': 'accelerometer', 'names': ['icing'], 'approximate': True}
    found = approximate_forms(certified, {'explanations': [explained, rival]})
    assert set(found) == ({'bias_temperature'} if approximate else set())
    assert approximate_forms(certified, None) == {}


@pytest.mark.parametrize(
    ('ratio', 'reason'),
    [(1.3, 'leaves more than noise'), (1.0, 'is probably off, by less than the noise')],
)
def test_the_conclusion_says_why_a_form_is_approximate(analysis, ratio, reason) -> None:
    dut1 = analysis.certified['dut1']
    part = dut1.model.sensors['accelerometer']
    lagging = replace(part, effects=(*part.effects, ThermalLag(70.0)))
    sensors = {**dut1.model.sensors, 'accelerometer': lagging}
    compared = dut1.comparison.sensors['accelerometer']
    left = replace(compared, held_out_rms=compared.noise_floor * (0.9, ratio, 0.9))
    certified = replace(
        dut1,
        model=replace(dut1.model, sensors=sensors),
        comparison=replace(dut1.comparison, sensors={'accelerometer': left}),
        added=('thermal_lag (accelerometer)',),
    )
    explained = {'sensor': 'accelerometer', 'names': ['thermal_lag'], 'approximate': True}
    diagnosis = {'explanations': [explained], 'steps': [], 'findings': []}
    said = conclusion(certified, [], [], [], diagnosis, (-10.0, 50.0))
    assert f'form approximate: its equation {reason}' in said
    exact = diagnosis | {'explanations': [explained | {'approximate': False}]}
    assert 'approximate' not in conclusion(certified, [], [], [], exact, (-10.0, 50.0))


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


def test_a_plan_without_a_name_is_that_of_the_set_points(run) -> None:
    named = run('dut1', 'z', cycles=3)
    bare = replace(named, profile='')
    assert conditions([named], 0.0, 1.0)['plan'] == 'short_plan'
    assert conditions([bare], 0.0, 1.0)['plan'] == 'set-points as recorded'
    assert conditions([replace(bare, setpoint=None)], 0.0, 1.0)['plan'] == 'not stated'


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


def test_the_conclusion_says_where_the_error_does_not_fall(analysis) -> None:
    certified = analysis.certified['dut1']
    row = {'sensor': 'gyroscope', 'before': 2.0, 'after': 1.0, 'ratio': 1.0}
    rows = [row | {'axis': 'x'}, row | {'axis': 'z', 'before': 0.9}]
    said = conclusion(certified, [], rows, [], None, (0.0, 40.0))
    assert 'does not lower the error of gyroscope z;' in said
    assert 'does not lower' not in conclusion(certified, [], rows[:1], [], None, (0.0, 40.0))


def test_loss_and_damage_stand_on_the_first_page(analysis) -> None:
    def page_of(*notes: str) -> str:
        first, *others = analysis.runs
        runs = (replace(first, recording=first.recording.with_notes(*notes)), *others)
        return report_page(content_of(replace(analysis, runs=runs))).partition('6 Result')[0]

    closed = 'metadata.yaml is missing: the recording was not closed'
    said = page_of(closed, 'up_axis +x is inferred from gravity')
    assert f'{closed} (dut1_x).' in said
    assert 'inferred' not in said
    assert 'Loss and damage' not in page_of()
    many = page_of(*(f'imu/{k}: {k} damaged messages left out' for k in range(1, 7)))
    assert 'imu/4: 4 damaged messages left out (dut1_x); 2 more in the annex.' in many


def test_gaps_of_a_recording_are_told(analysis) -> None:
    whole = analysis.runs[0].recording
    assert losses([whole]) == []
    cut = whole.rows(np.r_[0:1000, 1100 : len(whole)])
    assert losses([cut]) == ['1 gap, 100 s in all (dut1_x)']


def test_a_clock_that_was_not_set_is_told(run) -> None:
    late = run('dut1', 'z', cycles=3)
    early = replace(late, stamp=late.stamp - late.stamp[0] + 10**17)
    assert recording_row(early, '')['start'] == '1973-03-03 09:46, clock not set'
    assert 'clock' not in recording_row(late, '')['start']


def test_what_was_added_is_not_called_missing() -> None:
    added = SimpleNamespace(added=('thermal_lag',))
    lag = {
        'kind': 'effect',
        'sensor': 'accelerometer',
        'text': 'accelerometer: thermal_lag is missing',
    }
    other = {
        'kind': 'unlogged',
        'sensor': 'gyroscope',
        'text': 'gyroscope: a variable acts: chamber (60 %)',
    }
    diagnosis = {'steps': [], 'verdict': 'missing', 'findings': [lag]}
    assert not still_missing(added, diagnosis)
    both = diagnosis | {'findings': [lag, other]}
    assert still_missing(added, both) == 'gyroscope: a variable acts: chamber'


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


def test_a_mistake_in_the_laboratory_file_names_its_place(tmp_path: Path) -> None:
    path = tmp_path / 'laboratory.yaml'
    path.write_text('thermometer: {expanded_uncertainty: -1}\n')
    with pytest.raises(UserError, match=r'thermometer.expanded_uncertainty: -1'):
        read_laboratory(path)
    path.write_text('field: {value: 48, unit: µT}\n')
    with pytest.raises(UserError, match='expanded_uncertainty'):
        read_laboratory(path)
    path.write_text('field: {value: 48, expanded_uncertainty: 0.4, unit: µT}\n')
    assert read_laboratory(path).field == pytest.approx((48e-6, 0.2e-6))
    path.write_text('operater: nobody\n')
    with pytest.raises(UserError, match='did you mean operator'):
        read_laboratory(path)


def test_monte_carlo_sees_what_is_not_linear() -> None:
    small = budget_of(
        Measurand(1.0, span=60.0, power=1), 'T/K', [Input('c', 0.1, 'K', kind='span')]
    )
    assert small.monte_carlo == pytest.approx(small.combined, rel=0.02)
    large = budget_of(
        Measurand(1.0, span=6.0, power=2), 'T/K²', [Input('c', 1.2, 'K', kind='span')]
    )
    assert large.monte_carlo > 1.1 * large.combined


def covered(generator, scatter, devices: int) -> float:
    """Return how many 95 % intervals hold the truth, of slopes that scatter by noise, cycle, run.

    `scatter` draws the three standard deviations of a device.
    """
    number = np.repeat(np.arange(3), 4)
    hits = 0
    for _ in range(devices):
        noise, cycle, runs = scatter(generator)
        values = (
            generator.normal(0.0, runs, 3)[number]
            + generator.normal(0.0, cycle, 12)
            + generator.normal(0.0, noise, 12)
        )
        inputs, _ = scatter_inputs(noise / np.sqrt(12), 200.0, values, number, 'T/K')
        budget = budget_of(Measurand(float(values.mean())), 'T/K', inputs, draws=2)
        hits += abs(budget.value) <= budget.coverage_factor * budget.combined
    return hits / devices


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Over devices from one whose noise hides everything to one that every run changes."""

    def any_device(generator):
        return 1.0, 10.0 ** generator.uniform(-1.5, 0.5), 10.0 ** generator.uniform(-1.5, 0.5)

    assert covered(np.random.default_rng(3), any_device, 1000) == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize(
    'sigma', [(1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.3, 1.0, 2.0), (1.0, 0.0, 1.0)]
)
def test_no_kind_of_device_is_far_from_it(sigma) -> None:
    """Two degrees of freedom between runs cannot tell a small scatter from none."""
    share = covered(np.random.default_rng(3), lambda _: sigma, 1000)
    assert 0.91 < share < 0.985, sigma


def test_scatter_has_the_freedom_of_the_mean_square_it_adds_up_to() -> None:
    """A run-to-run scatter that barely exceeds the cycles' has that of the runs, never less."""
    values = np.array([0.9, 1.1, 1.13, 1.33])
    inputs, _ = scatter_inputs(0.01, 200.0, values, np.array([0, 0, 1, 1]), 'T/K')
    budget = budget_of(Measurand(1.115), 'T/K', inputs, draws=2)
    between = np.var([1.0, 1.23], ddof=1) / 2.0
    assert budget.combined**2 == pytest.approx(between)
    assert budget.degrees == pytest.approx(1.0)
    tilted = [*inputs, Input('tilt', budget.combined, 'T/K', shape='rectangular')]
    assert budget_of(Measurand(1.115), 'T/K', tilted, draws=2).degrees == pytest.approx(4.0)
    with pytest.raises(ValueError, match='dof'):
        budget_of(Measurand(1.0), 'T/K', [Input('noise', 1.0, 'T/K', 0.5)], draws=2)
