# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis says in words: thresholds where there are some, verdict first, advice last."""

import pytest
from thermal_comp.diagnosis.result import Diagnosis, Finding
from thermal_comp.presentation.diagnosis import (
    advice,
    diagnosis_text,
    prediction_lines,
    verdict_line,
)


@pytest.mark.parametrize(
    ('threshold', 'weight'), [(0.0, '(evidence 260)'), (25.0, '(evidence 260, needed 25)')]
)
def test_only_a_real_threshold_is_named(threshold: float, weight: str) -> None:
    text = 'run x: 26 of 900 rows'
    finding = Finding('data_quality', 'stuck_value', 'gyroscope', 260.0, threshold, text=text)
    lines = diagnosis_text(Diagnosis('dut1', (finding,), {}, {}, (), ()).to_dict()).splitlines()
    assert lines[1] == f'  {text} {weight}'


@pytest.mark.parametrize(
    ('finding', 'summary', 'next_step'),
    [
        (
            Finding(
                'effect', 'thermal_lag', 'gyroscope', 99.0, ambiguous_with=('temperature_rate',)
            ),
            'thermal_lag or temperature_rate (gyroscope)',
            'next-experiment thermal_lag temperature_rate',
        ),
        (
            Finding(
                'effect',
                'temperature_rate',
                'gyroscope',
                99.0,
                error_before=1e-4,
                error_after=2e-4,
                noise_floor=5e-5,
            ),
            'temperature_rate (gyroscope)',
            'leave temperature_rate out of the model',
        ),
        (
            Finding(
                'effect',
                'fixture_tilt',
                'accelerometer',
                0.0,
                ambiguous_with=('thermal_lag',),
                error_before=8.38e-4,
                error_after=8.48e-4,
                noise_floor=6.53e-4,
            ),
            'fixture_tilt or thermal_lag (accelerometer)',
            '  next: separate them first: python -m imu_workbench next-experiment fixture_tilt',
        ),
        (
            Finding('unlogged', None, 'magnetometer', 99.0, depends_on='chamber'),
            'depends on chamber (magnetometer)',
            'a motor or a lamp (in a chamber chamber/heater, chamber/compressor)',
        ),
        (
            Finding('unlogged', None, 'magnetometer', 99.0, depends_on='supply'),
            'depends on supply (magnetometer)',
            'log imu/supply_voltage',
        ),
        (
            Finding('unexplained', None, 'gyroscope', 99.0, depends_on='time'),
            'depends on time (gyroscope)',
            'residual over time',
        ),
    ],
)
def test_first_line_and_last_say_what_is_wrong_and_what_to_do(
    finding: Finding, summary: str, next_step: str
) -> None:
    lines = diagnosis_text(Diagnosis('dut1', (finding,), {}, {}, (), ()).to_dict()).splitlines()
    assert lines[0].endswith(summary)
    assert next_step in lines[-1]


@pytest.mark.parametrize(
    ('value', 'std', 'said'),
    [
        (1975.0, 15420.0, 't = 1975 ± 1.542e+04 s (not told by these recordings)'),
        ((1.9, 3.0), (4.0, 0.1), 't = (1.9, 3) ± (4, 0.1) s (± one standard deviation)'),
        (0.0, None, 't = 0 s'),
        (0.0, 0.05, 't = 0 ± 0.05 s (± one standard deviation)'),
    ],
)
def test_what_the_recordings_do_not_tell_is_not_said_as_if_they_did(
    value: object, std: object, said: str
) -> None:
    finding = Finding(
        'effect',
        'icing',
        'gyroscope',
        20.0,
        parameters={'t': {'value': value, 'std': std, 'unit': 's'}},
        rivals=({'name': 'humidity', 'probability': 0.3}, {'name': 'warm_up', 'probability': 0.3}),
    )
    lines = diagnosis_text(Diagnosis('dut1', (finding,), {}, {}, (), ()).to_dict()).splitlines()
    assert f'    {said}' in lines
    assert '    in its place, alone or together: humidity 30 %, warm_up 30 %' in lines


def test_a_sensor_that_was_not_judged_is_not_said_to_lack_nothing() -> None:
    judged = {'accelerometer': {'verdict': 'complete'}, 'gyroscope': {'verdict': 'complete'}}
    content = {'verdict': 'complete', 'findings': [], 'explanations': [], 'sensors': judged}
    said = verdict_line(content)
    assert said == 'nothing is missing in accelerometer and gyroscope, all that could be judged'


@pytest.mark.parametrize('verdict', ['complete', 'noise_above_reference'])
def test_an_error_of_the_thermometer_is_no_nothing(verdict: str) -> None:
    errors = {'noise_floor': 1e-4, 'error_before': 8e-4, 'error_after': 2e-4}
    content = Diagnosis('dut1', (), {}, {}, (), ()).to_dict() | {
        'verdict': verdict,
        'sensors': {'gyroscope': {'verdict': verdict}},
        'prediction': {'gyroscope': {'terms': ['thermal_lag'], 'empirical': True, **errors}},
    }
    assert verdict_line(content) == (
        'no effect is missing, but the thermometer errs (gyroscope 8.0 × noise)'
    )
    assert 'imu_workbench auto' in advice(content)[-1]


def test_what_would_not_lower_the_error_is_not_offered_as_if_it_did() -> None:
    def lines(verdict: str, after: float, terms: tuple[str, ...] = ('bias_step',)) -> list[str]:
        errors = {'noise_floor': 1e-4, 'error_before': 5e-4, 'error_after': after}
        prediction = {'gyroscope': {'terms': [*terms], 'empirical': True, **errors}}
        return prediction_lines(
            {'prediction': prediction, 'sensors': {'gyroscope': {'verdict': verdict}}}
        )

    (worse,) = lines('unlogged', 6e-4)
    assert 'bias_step, what comes closest, would not lower' in worse
    (better,) = lines('unexplained', 4e-4)
    assert 'add bias_step would bring' in better
    assert better.endswith('cause undecided')
    (nothing,) = lines('unexplained', 5e-4, ())
    assert 'no effect of the catalogue would lower' in nothing
    (late,) = lines('complete', 1e-4, ('thermal_lag',))
    assert late.endswith('the thermometer errs')


def test_a_note_stands_once() -> None:
    note = 'gyroscope left out: axis z of run a never changes'
    told = Diagnosis('dut1', (), {}, {}, (), (note, note)).to_dict()
    assert told['notes'] == [note, note]
    assert diagnosis_text(told).count(note) == 1


def test_the_first_line_says_what_each_sensor_lacks_and_that_data_were_left_out() -> None:
    unlogged = Finding('unlogged', None, 'accelerometer', 99.0, depends_on='chamber')
    step = Finding('effect', 'bias_step', 'gyroscope', 83.0)
    spikes = Finding('data_quality', 'spikes', 'gyroscope', 20.0)
    both = 'something acts that was not logged: depends on chamber (accelerometer)'
    missing = 'an effect is missing: bias_step (gyroscope)'
    found = Diagnosis('dut1', (unlogged, step), {}, {}, (), ()).to_dict()
    assert verdict_line(found) == f'{both}; {missing}'
    found = Diagnosis('dut1', (unlogged, step, spikes), {}, {}, (), ()).to_dict()
    assert verdict_line(found).endswith(f'spikes (gyroscope); {missing}; {both}')
