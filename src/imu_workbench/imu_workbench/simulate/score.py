# SPDX-License-Identifier: Apache-2.0
"""A diagnosis scored against the truth of a campaign with hidden effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

ALARM_KINDS = ('effect', 'unexplained', 'unlogged')
"""Kinds of finding that must not appear where nothing is hidden."""
VERDICTS = {
    'named': 'right: it is named first',
    'in_set': 'right: it is in the reported set, not in first place',
    'missed': 'missed: nothing of the kind was reported',
    'wrong': 'wrong: something else was reported',
}


@dataclass(frozen=True)
class Score:
    """A diagnosis compared with the truth."""

    outcome: str
    """One of VERDICTS."""
    sensor_right: bool
    """Whether the finding that counts is in the right sensor."""
    reported: tuple[str, ...]
    """What was reported, strongest first."""

    @property
    def right(self) -> bool:
        """Whether the truth is among what was reported, in its sensor."""
        return self.outcome in ('named', 'in_set') and self.sensor_right


def score_each(truths: Sequence[Mapping[str, Any]], diagnosis: Mapping[str, Any]) -> list[Score]:
    """Return the score of every hidden effect, without findings that only another one explains.

    >>> lag = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope'}
    >>> ice = {'kind': 'effect', 'name': 'icing', 'sensor': 'gyroscope'}
    >>> [s.outcome for s in score_each([ice, lag], {'findings': [lag, ice]})]
    ['named', 'named']
    """
    scores = []
    for truth in truths:
        others = [other for other in truths if other is not truth]
        findings = [
            finding
            for finding in diagnosis['findings']
            if fits_in_sensor(truth, finding)
            or not any(fits_in_sensor(other, finding) for other in others)
        ]
        scores.append(score_diagnosis(truth, {**diagnosis, 'findings': findings}))
    return scores


def score_diagnosis(truth: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> Score:
    """Return how the JSON answer of `diagnose` compares with the truth of a campaign.

    >>> truth = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope'}
    >>> finding = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope'}
    >>> score_diagnosis(truth, {'findings': [finding]}).outcome
    'named'
    >>> score_diagnosis(truth, {'findings': []}).outcome
    'missed'
    """
    findings: Sequence[Mapping[str, Any]] = diagnosis['findings']
    reported = tuple(describe(finding) for finding in findings)
    if truth['kind'] == 'nothing':
        alarms = [finding for finding in findings if finding['kind'] in ALARM_KINDS]
        return Score('wrong' if alarms else 'named', True, reported)
    fitting = [k for k, finding in enumerate(findings) if fits(truth, finding)]
    if not fitting:
        others = any(finding['kind'] in (*ALARM_KINDS, 'data_quality') for finding in findings)
        return Score('wrong' if others else 'missed', False, reported)
    best = fitting[0]
    first = best == 0 and not _only_as_rival(truth, findings[best])
    right_sensor = any(same_sensor(truth['sensor'], findings[k]['sensor']) for k in fitting)
    return Score('named' if first else 'in_set', right_sensor, reported)


def fits(truth: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    """Tell whether a finding is what was hidden, by name or, beyond the catalogue, by variable."""
    if truth['kind'] in ('unexplained', 'unlogged'):
        variables = [*truth['depends_on'], *_close_to(truth['depends_on'])]
        return finding['kind'] in ('unexplained', 'unlogged') and (
            finding.get('depends_on') in variables
        )
    names = [finding.get('name'), *finding.get('ambiguous_with', ())]
    return finding['kind'] in (truth['kind'], 'changed', 'clock') and truth['name'] in names


def fits_in_sensor(truth: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    """Tell whether a finding is what was hidden, where it was hidden."""
    return fits(truth, finding) and same_sensor(truth.get('sensor'), finding.get('sensor'))


def same_sensor(true: str | None, reported: str | None) -> bool:
    """Tell whether a reported sensor covers the true one.

    >>> same_sensor('gyroscope', 'all'), same_sensor('gyroscope', 'accelerometer+magnetometer')
    (True, False)
    """
    if true is None or reported is None:
        return True
    if 'all' in (true, reported):
        return True
    return bool(set(true.split('+')) & set(reported.split('+')))


def describe(finding: Mapping[str, Any]) -> str:
    """Return one finding in a few words."""
    what = finding.get('name') or f'{finding["kind"]} ({finding.get("depends_on") or "?"})'
    rivals = finding.get('ambiguous_with') or ()
    alternative = f' or {" or ".join(rivals)}' if rivals else ''
    return f'{what}{alternative} in {finding.get("sensor") or "?"}'


def _only_as_rival(truth: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    return truth['kind'] in ('effect', 'data_quality') and finding.get('name') != truth['name']


def _close_to(variables: Sequence[str]) -> tuple[str, ...]:
    """Return variables that stand for the same: the cycle number grows with time."""
    return ('cycle',) if 'time' in variables else ()
