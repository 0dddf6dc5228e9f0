# SPDX-License-Identifier: Apache-2.0
"""Profiles: what ships is the plan it claims to be; what is wrong is found at once, in place."""

import pytest
import yaml
from chamber_profile.profile.check import ProfileError
from chamber_profile.profile.file import (
    load_profile,
    parse_profile,
    profile_from_content,
    profile_names,
)
from chamber_profile.profile.unroll import campaign_steps

PAPER = load_profile('paper_betta2022')


def lengths(profile) -> float:
    """Length of a run in seconds, straight from its steps."""
    at, total = profile.start_c, 0.0
    for step in profile.run_steps:
        total += abs(step.target_c - at) / step.rate_c_per_min * 60 + step.dwell_s
        at = step.target_c
    return total


def test_the_papers_plan_takes_twelve_hours_and_visits_its_temperatures() -> None:
    assert lengths(PAPER) == 12 * 3600
    assert [step.target_c for step in PAPER.run_steps[:7]] == [20, -10, -10, 50, 50, 20, 20]
    assert max(step.cycle for step in PAPER.run_steps) == 4
    last = [step.phase for step in PAPER.run_steps[-3:]]
    assert last == ['ramp_down', 'dwell_reference', 'final']


@pytest.mark.parametrize('name', profile_names())
def test_every_shipped_profile_loads_and_keeps_its_own_limits(name: str) -> None:
    profile = load_profile(name)
    assert profile.name == name
    for step in campaign_steps(profile):
        assert profile.limits.air_min_c <= step.target_c <= profile.limits.air_max_c
        assert 0 < step.rate_c_per_min <= profile.limits.rate_max_c_per_min


def test_a_copy_in_a_file_is_the_same_profile(tmp_path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(PAPER.text)
    assert load_profile(path) == PAPER
    assert load_profile(path).sha256 == PAPER.sha256
    assert profile_from_content(yaml.safe_load(PAPER.text)) == PAPER


def test_all_errors_come_at_once_each_with_its_line() -> None:
    text = (
        PAPER.text.replace('target_c: 50', 'target_c: .nan')
        .replace('rate_c_per_min: 2, dwell_s: 5400', 'rate_c_per_min: 0, dwell_s: 5400, coffee: 1')
        .replace('from: cool', 'from: col')
        .replace('target_c: -10', 'target_c: -100')
        + '\nname: twice\n'
    )
    lines = text.splitlines()
    with pytest.raises(ProfileError) as caught:
        parse_profile(text, 'bad.yaml')
    found = {}
    for line in str(caught.value).splitlines():
        source, number, what = line.split(':', 2)
        assert source == 'bad.yaml'
        found[what] = lines[int(number) - 1]
    expected = {
        'coffee: unknown key': 'id: precondition',
        'rate_c_per_min: 0 is': 'id: precondition',
        'target_c -100 is outside': 'id: cool',
        'target_c is nan': 'id: heat',
        "no step 'col'": 'cycles:',
        "'name' is given twice": 'name: twice',
    }
    assert len(found) == len(expected)
    for words, place in expected.items():
        assert [line for what, line in found.items() if words in what and place in line], words


@pytest.mark.parametrize(
    ('change', 'complaint'),
    [
        (('kind: final, ', 'kind: finale, '), 'finale'),
        (('to: reference, count: 4', 'to: reference, count: 0'), 'count is 0'),
        (('cycles: {from: cool, to', 'cycles: {from: hot, to'), ''),
        (('cycles: {from: cool, to: reference', 'cycles: {from: hot, to: cool'), 'comes after'),
        (('dwell_s: 1800}', 'dwell_s: -5}'), '-5'),
        (('air_min_c: -15', 'air_min_c: 60'), 'not below'),
        (('device_max_c: 85', 'device_max_c: 30'), 'outside the limits -15 … 30'),
        (('{id: hot,', '{id: cold,'), "id 'cold' is already that of"),
        (('id: cold, kind: dwell', 'id: cold, kind: dwell, target_c: 0'), 'put a ramp between'),
        (('schema: 1', 'schema: 2'), '1 was expected'),
        (('rate_max_c_per_min: 2', 'rate_max_c_per_min: 1'), 'above the limit 1'),
        (('steps:', 'steps: ['), 'not valid YAML'),
        (('schema: 1', 'schema: 2024-99-99'), 'not valid YAML: month must be'),
        (('schema: 1', 'schema: ' + '[' * 5000), 'not valid YAML'),
        ((PAPER.text, ''), 'empty'),
        ((PAPER.text, '- 1'), 'object'),
    ],
)
def test_each_error_is_named(change: tuple[str, str], complaint: str) -> None:
    text = PAPER.text.replace(*change)
    assert text != PAPER.text
    if not complaint:
        parse_profile(text)
        return
    with pytest.raises(ProfileError, match=complaint):
        parse_profile(text)


def test_an_unknown_profile_lists_those_there_are() -> None:
    with pytest.raises(ProfileError, match='paper_betta2022'):
        load_profile('nonsense')
