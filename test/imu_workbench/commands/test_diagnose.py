# SPDX-License-Identifier: Apache-2.0
"""diagnose: the lag that was put in is named, under a line or a model; an unknown chip refuses."""

from __future__ import annotations

from pathlib import Path

from .asking import Answer, refuses


def test_the_lag_is_named_in_its_sensor_under_a_line_and_under_a_model(
    bag: Path, model: Path, answer: Answer
) -> None:
    for argv in (('diagnose', bag), ('diagnose', bag, '--model', model)):
        code, content, text = answer(*argv)
        assert code == 0
        first = content['findings'][0]
        assert (first['kind'], first['sensor']) == ('effect', 'gyroscope')
        assert {first['name'], *first['ambiguous_with']} & {'thermal_lag', 'thermal_lag_two_stage'}
        assert 'gyroscope' in text


def test_a_noise_reference_that_is_no_chip_is_refused(bag: Path, answer: Answer) -> None:
    line = refuses(answer, 'diagnose', bag, '--noise-reference', 'mpu925')
    assert 'did you mean mpu9250' in line
