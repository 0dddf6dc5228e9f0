# SPDX-License-Identifier: Apache-2.0
"""Scores of answers against truths, as everyday.py keeps them: calibration, names, corrections.

An answer is, per sensor or group of sensors, a list of sets of names with a probability each.
Where a diagnosis gives no probabilities, its findings are read as such: a name for 0.95, names it
cannot tell apart for their share of that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

Row: TypeAlias = Mapping[str, Any]
SENSORS = ('accelerometer', 'gyroscope', 'magnetometer')
NOTHING, OUTSIDE, UNLOGGED = 'nothing', 'not_in_catalogue', 'unlogged'
NO_NAMES = frozenset({NOTHING, OUTSIDE, UNLOGGED})
LABORATORY = ('full_lab', 'own_laboratory')
STATED = 0.95
"""Probability that findings without one are read as."""
HYPOTHESES = 27
"""Effects of the catalogue and the three further hypotheses: what a uniform guess spreads over."""
LEAST_PROBABILITY = 1e-4
THERMOMETER_SEEN = 0.3
"""Magnitude from which the thermometer's own lag rightly shows as one of the sensor."""
BEHIND = frozenset({'thermal_lag', 'thermal_lag_two_stage', 'temperature_rate', 'warm_up'})
"""Names for that."""
SEPARATED = 0.9
INDISTINCT = 0.95
"""Share of an unlogged effect that another explains, from which that name is as good."""
BINS = ((0.3, 1.0), (1.0, 3.0), (3.0, 15.0), (15.0, 61.0))


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
    required = tuple(_names(one) for one in acting)
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


def _names(effect: Mapping[str, Any]) -> frozenset[str]:
    if not effect['in_catalogue']:
        return frozenset({OUTSIDE})
    name = str(effect['name'])
    if effect['logged']:
        return frozenset({name})
    alike = effect.get('rival_share', 0.0) >= INDISTINCT
    return frozenset({name, UNLOGGED, effect['rival']} if alike else {name, UNLOGGED})


# Tables ------------------------------------------------------------------------------------------


def tables(rows: Sequence[Row]) -> str:
    """Return all tables; sample sizes stand in brackets."""
    whole = [row for row in rows if 'findings' in row]
    if not whole:
        return f'{broken(rows)}\nno campaign has been diagnosed'
    kinds = dict.fromkeys(row['kind'] for row in whole)
    scenarios = [(kind, [row for row in whole if row['kind'] == kind]) for kind in kinds]
    magnitudes = [(f'{low:g} … {high:g}', _one_effect(whole, low, high)) for low, high in BINS]
    parts = (
        broken(rows),
        _table('scenario', [*scenarios, ('all', whole)], PER_SCENARIO),
        reliability(whole),
        'One effect of the catalogue whose channel was logged',
        _table('M', magnitudes, PER_MAGNITUDE),
        further(whole),
    )
    return '\n\n'.join(parts)


def broken(rows: Sequence[Row]) -> str:
    """Return how many campaigns have no answer, and why."""
    failed = [row for row in rows if 'crash' in row or 'refused' in row]
    counts = f'{len(rows)} campaigns, {len(failed)} of them crashed or refused'
    reasons = (
        f'{row["seed"]} {row["kind"]}: {row.get("crash") or row["refused"]}' for row in failed
    )
    return '\n'.join([counts, *reasons])


Measure: TypeAlias = Callable[[Sequence[Row]], str]


def _table(
    first: str, lines: Iterable[tuple[str, Sequence[Row]]], columns: Mapping[str, Measure]
) -> str:
    cells = [[first, *columns]]
    cells += [
        [name, *(measure(rows) for measure in columns.values())] for name, rows in lines if rows
    ]
    widths = [max(len(line[k]) for line in cells) for k in range(len(cells[0]))]
    return '\n'.join(
        '  '.join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip()
        for line in cells
    )


def _share(hits: Iterable[bool]) -> str:
    listed = list(hits)
    return f'{np.mean(listed):.0%} ({len(listed)})' if listed else '–'


def _all_groups(rows: Sequence[Row]) -> list[Group]:
    return [group for row in rows for group in groups(row)]


def hypotheses(rows: Sequence[Row]) -> np.ndarray:
    """Return (n, 2): every reported probability, and whether the set was right."""
    pairs = [(p, group.right(names)) for group in _all_groups(rows) for names, p in group.sets]
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
    stated = [np.array([p for _, p in group.sets]) for group in _all_groups(rows)]
    values = np.concatenate([*stated, np.zeros(0)])
    errors = []
    for _ in range(draws):
        drawn = [rng.random() < np.cumsum(p) for p in stated]
        first = [np.diff(np.concatenate([[False], d]).astype(int)) > 0 for d in drawn]
        right = np.concatenate([*first, np.zeros(0, bool)])
        errors.append(calibration_error(np.column_stack([values, right])))
    return errors


def brier(group: Group) -> float:
    total = sum((p - group.right(names)) ** 2 for names, p in group.sets)
    return total + (0.0 if any(group.right(names) for names, _ in group.sets) else 1.0)


def log_score(group: Group) -> float:
    right = sum(p for names, p in group.sets if group.right(names))
    return float(-np.log(max(right, LEAST_PROBABILITY)))


def _calibration(rows: Sequence[Row]) -> str:
    pairs = hypotheses(rows)
    return f'{calibration_error(pairs):.3f} ({len(pairs)})'


def _coverage(rows: Sequence[Row]) -> str:
    return _share(any(map(g.right, g.credible)) for g in _all_groups(rows))


def _set_size(rows: Sequence[Row]) -> str:
    sizes = [len(group.credible) for group in _all_groups(rows) if group.magnitude >= 3.0]
    return f'{np.median(sizes):g} ({len(sizes)})' if sizes else '–'


def _mean_of(score: Callable[[Group], float]) -> Measure:
    def mean(rows: Sequence[Row]) -> str:
        values = [score(group) for group in _all_groups(rows)]
        return f'{np.mean(values):.2f}' if values else '–'

    return mean


def _first_right(rows: Sequence[Row]) -> str:
    return _share(all(g.right(g.sets[0][0]) for g in groups(row)) for row in rows)


def _sure_and_wrong(rows: Sequence[Row]) -> str:
    return _share(
        not group.right(names)
        for group in _all_groups(rows)
        for names, p in group.sets
        if p > 0.9 and not names & NO_NAMES
    )


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


def _ratio(rows: Sequence[Row]) -> str:
    ratios = error_ratios(rows)
    if not ratios:
        return '–'
    return (
        f'{np.median(ratios):.2f}, ≤ 1.1 {np.mean(np.array(ratios) <= 1.1):.0%}, '
        f'≤ 1.3 {np.mean(np.array(ratios) <= 1.3):.0%} ({len(ratios)})'
    )


def _seconds(rows: Sequence[Row]) -> str:
    return f'{np.median([row["cpu_s"].get("diagnose", np.nan) for row in rows]):.1f}'


PER_SCENARIO: Mapping[str, Measure] = {
    'n': lambda rows: str(len(rows)),
    'first right': _first_right,
    'ECE': _calibration,
    '95 % sets hold': _coverage,
    'size, M ≥ 3': _set_size,
    'Brier': _mean_of(brier),
    'log': _mean_of(log_score),
    'P > 0.9 wrong': _sure_and_wrong,
    'error in floors': _ratio,
    'cpu [s]': _seconds,
}


def reliability(rows: Sequence[Row]) -> str:
    """Return the table of stated against found probability."""
    pairs = hypotheses(rows)
    lines = ['Stated probability   found   n']
    for k in range(10):
        inside = pairs[np.minimum((10.0 * pairs[:, 0]).astype(int), 9) == k]
        if len(inside):
            stated, found = inside.mean(0)
            lines.append(
                f'{k / 10:.1f} … {k / 10 + 0.1:.1f}: {stated:.2f}   {found:.2f}    {len(inside)}'
            )
    low, middle, high = np.percentile(errors_if_calibrated(rows), [5, 50, 95])
    lines.append(
        f'ECE {calibration_error(pairs):.3f}; by chance, were each right as often as stated, '
        f'{middle:.3f} ({low:.3f} … {high:.3f}, 90 %)'
    )
    brier_guess = 1.0 - 1.0 / HYPOTHESES
    lines.append(f'(a uniform guess: Brier {brier_guess:.2f}, log {np.log(HYPOTHESES):.2f})')
    return '\n'.join(lines)


def _one_effect(rows: Sequence[Row], low: float, high: float) -> list[Row]:
    return [
        row
        for row in rows
        if len(row['truth']['effects']) == 1
        and low <= row['truth']['effects'][0]['magnitude'] < high
        and row['truth']['effects'][0]['in_catalogue']
        and row['truth']['effects'][0]['logged']
    ]


def _of_effect(row: Row) -> list[Group]:
    return [group for group in groups(row) if group.required]


PER_MAGNITUDE: Mapping[str, Measure] = {
    'n': lambda rows: str(len(rows)),
    'first right': lambda rows: _share(
        all(g.right(g.sets[0][0]) for g in _of_effect(row)) for row in rows
    ),
    'in the 95 % set': lambda rows: _share(
        all(any(map(g.right, g.credible)) for g in _of_effect(row)) for row in rows
    ),
    'first says nothing': lambda rows: _share(
        all(g.sets[0][0] <= {NOTHING} for g in _of_effect(row)) for row in rows
    ),
    'P > 0.9 wrong': _sure_and_wrong,
    'whole campaign right': _first_right,
}


def _keeps_nothing(row: Row) -> bool:
    return all(
        sum(p for names, p in group.sets if names <= {NOTHING}) > 0.5 for group in groups(row)
    )


def _first_names(row: Row) -> frozenset[str]:
    return frozenset().union(*(group.sets[0][0] for group in groups(row)))


def _has_all(row: Row) -> bool:
    said = _first_names(row)
    return all(_names(effect) & said for effect in row['truth']['effects'])


def _ends_outside(row: Row) -> bool:
    return all(OUTSIDE in group.sets[0][0] for group in _of_effect(row))


def _has_no_name(row: Row) -> bool:
    return all(group.sets[0][0] <= {OUTSIDE, UNLOGGED} for group in _of_effect(row))


def _behind(row: Row) -> float:
    return max(row['truth'].get('thermometer_magnitude', {'': 0.0}).values())


def _several(rows: Sequence[Row], count: int) -> list[Row]:
    return [
        row
        for row in rows
        if len(row['truth']['effects']) == count
        and min(effect['magnitude'] for effect in row['truth']['effects']) >= 3.0
    ]


def _can_be_told(effect: Mapping[str, Any]) -> bool:
    """Tell whether an effect's channel was logged and no other effect explains most of it."""
    return bool(effect['logged']) and effect.get('rival_share', 0.0) < SEPARATED


def _separated(row: Row) -> bool:
    return float(row['truth'].get('overlap', 0.0)) < SEPARATED


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


def further(rows: Sequence[Row]) -> str:
    """Return one line per further aim."""
    nulls = [row for row in rows if not row['truth']['effects']]
    clean = [row for row in nulls if _behind(row) < THERMOMETER_SEEN]
    slow = [row for row in nulls if _behind(row) >= THERMOMETER_SEEN]
    outside = [
        row
        for row in rows
        if any(not e['in_catalogue'] and e['magnitude'] >= 3.0 for e in row['truth']['effects'])
    ]
    unlike = [r for r in outside if r['truth']['effects'][0].get('rival_share', 0.0) < SEPARATED]
    unlogged = [row for row in rows if row['truth']['unlogged'] and len(_of_effect(row)) == 1]
    lines = {
        'nothing hidden: P(nothing) > 0.5 on all sensors': _share(map(_keeps_nothing, clean)),
        '  where the thermometer lags visibly': _share(map(_keeps_nothing, slow)),
        'unlisted laws, M ≥ 3: first answer outside': _share(map(_ends_outside, outside)),
        '  or a lost channel': _share(map(_has_no_name, outside)),
        '  unless an effect explains 90 % of them': _share(map(_ends_outside, unlike)),
        'channel not logged: said, or the name': _share(
            all(g.right(g.sets[0][0]) for g in _of_effect(row)) for row in unlogged
        ),
        'names with P > 0.9 that are wrong': _sure_and_wrong(rows),
        'a channel that does not act dropped: no P moves by > 0.05': _share(
            shift(row) <= 0.05 for row in rows if 'without' in row
        ),
        '± 2 σ of shape parameters hold the truth': _share(intervals(rows)),
        'error in floors, laboratory': _ratio([r for r in rows if r['kind'] in LABORATORY]),
        'error in floors, everyday': _ratio([r for r in rows if r['kind'] not in LABORATORY]),
    }
    for count, word in ((2, 'two'), (3, 'three')):
        several = _several(rows, count)
        apart = [row for row in several if _separated(row)]
        lines[f'{word} effects, M ≥ 3, overlap < 0.9: all in the first answers'] = _share(
            map(_has_all, apart)
        )
        told = [row for row in apart if all(map(_can_be_told, row['truth']['effects']))]
        lines[f'  {word}, each logged, none nine tenths like another effect'] = _share(
            map(_has_all, told)
        )
        lines[f'{word} effects, M ≥ 3: the 95 % sets hold them'] = _share(
            all(any(map(g.right, g.credible)) for g in _of_effect(row)) for row in several
        )
    width = max(map(len, lines))
    return '\n'.join(f'{name.ljust(width)}  {value}' for name, value in lines.items())
