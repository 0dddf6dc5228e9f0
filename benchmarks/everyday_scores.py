# SPDX-License-Identifier: Apache-2.0
"""Scores of answers against truths, as everyday.py keeps them.

An answer is, per sensor or group of sensors, a list of sets of names with a probability each.
Where a diagnosis gives no probabilities, its findings are read as such: a name for 0.95, names it
cannot tell apart for their share of that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

Row: TypeAlias = Mapping[str, Any]
SENSORS = ('accelerometer', 'gyroscope', 'magnetometer')
NOTHING, OUTSIDE, UNLOGGED = 'nothing', 'not_in_catalogue', 'unlogged'
NO_NAMES = frozenset({NOTHING, OUTSIDE, UNLOGGED})
STATED = 0.95
"""Probability that findings without one are read as."""
LEAST_PROBABILITY = 1e-4
THERMOMETER_SEEN = 0.3
"""Magnitude from which the thermometer's own lag rightly shows as one of the sensor."""
BEHIND = frozenset({'thermal_lag', 'thermal_lag_two_stage', 'temperature_rate', 'warm_up'})
"""Names for that."""
INDISTINCT = 0.95
"""Share of an unlogged effect that another explains, from which that name is as good."""


@dataclass(frozen=True)
class Group:
    """What was said about some sensors, most probable first, and what was right."""

    sensors: tuple[str, ...]
    sets: tuple[tuple[frozenset[str], float], ...]
    required: tuple[frozenset[str], ...]
    """Per hidden effect on these sensors: the names that are right for it."""
    magnitude: float
    """Of the largest hidden effect; 0 for none."""

    def right(self, names: frozenset[str]) -> bool:
        """Whether a set of names is the truth."""
        if not self.required:
            return names == {NOTHING}
        accepted = frozenset().union(*self.required)
        return all(one & names for one in self.required) and names <= accepted

    @property
    def credible(self) -> Sequence[frozenset[str]]:
        """The smallest list of sets that holds 95 %."""
        taken: list[frozenset[str]] = []
        total = 0.0
        for names, probability in self.sets:
            if total >= 0.95 - 1e-9:
                break
            taken.append(names)
            total += probability
        return taken


def groups(row: Row) -> list[Group]:
    """Return what was said about every sensor."""
    said = _explained(row) if row.get('explanations') else _found(row)
    silent = set(SENSORS) & set(row.get('sensors', SENSORS)) - set('+'.join(said).split('+'))
    if '' not in said:
        said |= {sensor: [(frozenset({NOTHING}), STATED)] for sensor in silent}
    return [_group(row['truth'], name, sets) for name, sets in said.items()]


Said: TypeAlias = dict[str, list[tuple[frozenset[str], float]]]


def _explained(row: Row) -> Said:
    said: Said = {}
    for one in row['explanations']:
        names = frozenset(one['names'] or (NOTHING,))
        said.setdefault(one.get('sensor') or '', []).append((names, float(one['probability'])))
    return said


def _found(row: Row) -> Said:
    """Read today's findings as probabilities: all effects of a sensor are one set."""
    kinds = {'unexplained': OUTSIDE, 'unlogged': UNLOGGED}
    named: dict[str, list[list[str]]] = {}
    for finding in row.get('findings', ()):
        if finding['kind'] == 'effect':
            choices = [finding['name'], *finding['ambiguous_with']]
        elif finding['kind'] in kinds:
            choices = [kinds[finding['kind']]]
        else:
            continue
        for sensor in (finding['sensor'] or '').split('+'):
            named.setdefault(sensor, []).append(choices)
    said: Said = {}
    for sensor, listed in named.items():
        first, rest = listed[0], frozenset(choices[0] for choices in listed[1:])
        share = STATED / len(first)
        said[sensor] = [(frozenset({name}) | rest, share) for name in first]
    return said


def _group(truth: Mapping[str, Any], name: str, sets: list[tuple[frozenset[str], float]]) -> Group:
    sensors = tuple(name.split('+')) if name else SENSORS
    acting = [one for one in truth['effects'] if set(one['sensors']) & set(sensors)]
    behind = truth.get('thermometer_magnitude', {})
    seen = max((behind.get(sensor, 0.0) for sensor in sensors), default=0.0)
    required = tuple(right_names(one) for one in acting)
    tolerated = BEHIND.difference(*required) if seen >= THERMOMETER_SEEN else frozenset()
    return Group(
        sensors,
        tuple(sorted(_merged(sets, tolerated).items(), key=lambda one: -one[1])),
        required,
        max((float(one['magnitude']) for one in acting), default=0.0),
    )


def _merged(
    sets: list[tuple[frozenset[str], float]], tolerated: frozenset[str]
) -> dict[frozenset[str], float]:
    """Return sets that differ by tolerated names alone as one: the same is right of them."""
    merged: dict[frozenset[str], float] = {}
    for names, probability in sets:
        left = names - tolerated or frozenset({NOTHING})
        merged[left] = merged.get(left, 0.0) + probability
    return merged


def right_names(effect: Mapping[str, Any]) -> frozenset[str]:
    """Return the names that are right for a hidden effect."""
    if not effect['in_catalogue']:
        return frozenset({OUTSIDE})
    name = str(effect['name'])
    if effect['logged']:
        return frozenset({name})
    alike = effect.get('rival_share', 0.0) >= INDISTINCT
    return frozenset({name, UNLOGGED, effect['rival']} if alike else {name, UNLOGGED})


def all_groups(rows: Sequence[Row]) -> list[Group]:
    """Return what was said about every sensor of every campaign."""
    return [group for row in rows for group in groups(row)]


def hypotheses(rows: Sequence[Row]) -> np.ndarray:
    """Return (n, 2): every reported probability, and whether the set was right."""
    pairs = [(p, group.right(names)) for group in all_groups(rows) for names, p in group.sets]
    return np.array(pairs, dtype=float).reshape(-1, 2)


def calibration_error(pairs: np.ndarray) -> float:
    """Return the expected calibration error over ten bins."""
    bins = np.minimum((10.0 * pairs[:, 0]).astype(int), 9)
    error = sum(
        abs(float(np.sum(pairs[bins == k, 0] - pairs[bins == k, 1]))) for k in np.unique(bins)
    )
    return error / max(len(pairs), 1)


def errors_if_calibrated(rows: Sequence[Row], draws: int = 200) -> list[float]:
    """Return what the calibration error would be by chance if every probability were right.

    Of each answer one set is drawn to be the truth, by the probabilities themselves.
    """
    rng = np.random.default_rng(0)
    stated = [np.array([p for _, p in group.sets]) for group in all_groups(rows)]

    def drawn() -> np.ndarray:
        truths = [int(np.searchsorted(np.cumsum(p), rng.random())) for p in stated]
        right = [np.arange(len(p)) == k for p, k in zip(stated, truths, strict=True)]
        return np.column_stack([np.concatenate(stated), np.concatenate(right)])

    return [calibration_error(drawn()) for _ in range(draws)] if stated else [0.0]


def brier(group: Group) -> float:
    total = sum((p - group.right(names)) ** 2 for names, p in group.sets)
    return total + (0.0 if any(group.right(names) for names, _ in group.sets) else 1.0)


def log_score(group: Group) -> float:
    right = sum(p for names, p in group.sets if group.right(names))
    return float(-np.log(max(right, LEAST_PROBABILITY)))


def error_ratios(rows: Sequence[Row]) -> list[float]:
    """Return per sensor the predicted error of the correction, in errors of the true form."""
    ratios = []
    for row in rows:
        for sensor, floor in row.get('true_form', {}).items():
            error = _error_after(row, sensor)
            if error is not None and np.isfinite(error) and floor > 0.0:
                ratios.append(error / floor)
    return ratios


def _error_after(row: Row, sensor: str) -> float | None:
    """Return the held-out error of the correction: that of `auto`, else of what was named."""
    for one in _predictions(row.get('auto') or row.get('prediction')):
        error = one.get('error_after')
        if isinstance(error, Mapping):
            error = error.get(sensor)
        elif sensor not in str(one.get('sensor', '')).split('+'):
            error = None
        if error is not None:
            return float(np.sqrt(np.mean(np.square(error))))
    found = [
        finding['error_after']
        for finding in row.get('findings', ())
        if sensor in (finding['sensor'] or '').split('+') and finding.get('error_after')
    ]
    before = row.get('sensors', {}).get(sensor, {}).get('held_out')
    return min([*found, *([before] if before is not None else [])], default=None)


def _predictions(prediction: Any) -> Iterable[Mapping[str, Any]]:
    """Return one mapping per sensor, however the result lays them out."""
    if isinstance(prediction, Mapping) and 'error_after' not in prediction:
        return [{'sensor': name, **one} for name, one in prediction.items() if one]
    return prediction if isinstance(prediction, list) else [prediction] if prediction else []


def intervals(rows: Sequence[Row]) -> list[bool]:
    """Return for every shape parameter of a rightly named effect whether ± 2 σ hold the truth."""
    held = []
    for row in rows:
        true = {effect['name']: effect['parameters'] for effect in row['truth']['effects']}
        for finding in row['findings']:
            if finding['kind'] != 'effect' or finding['name'] not in true:
                continue
            for name, stated in (finding.get('parameters') or {}).items():
                value = true[finding['name']].get(name)
                alone = isinstance(value, float) and isinstance(stated['value'], float)
                if alone and stated.get('std'):
                    held.append(abs(stated['value'] - value) <= 2.0 * stated['std'])
    return held


def shift(row: Row) -> float:
    """Return how far any probability moved when a channel that does not act was dropped."""
    without = {**row, 'explanations': None, **row['without']}
    said = [
        {(group.sensors, names): p for group in groups(one) for names, p in group.sets}
        for one in (row, without)
    ]
    return max(abs(said[0].get(key, 0.0) - said[1].get(key, 0.0)) for key in said[0] | said[1])
