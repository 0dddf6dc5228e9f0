# SPDX-License-Identifier: Apache-2.0
"""Tables of the scores of many campaigns: calibration, names, corrections."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from everyday_scores import (
    NO_NAMES,
    NOTHING,
    OUTSIDE,
    THERMOMETER_SEEN,
    UNLOGGED,
    Group,
    Row,
    all_groups,
    brier,
    calibration_error,
    error_ratios,
    errors_if_calibrated,
    groups,
    hypotheses,
    intervals,
    log_score,
    right_names,
    shift,
)

LABORATORY = ('full_lab', 'own_laboratory')
HYPOTHESES = 27
"""Effects of the catalogue and the three further hypotheses: what a uniform guess spreads over."""
SEPARATED = 0.9
BINS = ((0.3, 1.0), (1.0, 3.0), (3.0, 15.0), (15.0, 61.0))


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


def _calibration(rows: Sequence[Row]) -> str:
    pairs = hypotheses(rows)
    return f'{calibration_error(pairs):.3f} ({len(pairs)})'


def _coverage(rows: Sequence[Row]) -> str:
    return _share(any(map(g.right, g.credible)) for g in all_groups(rows))


def _set_size(rows: Sequence[Row]) -> str:
    sizes = [len(group.credible) for group in all_groups(rows) if group.magnitude >= 3.0]
    return f'{np.median(sizes):g} ({len(sizes)})' if sizes else '–'


def _mean_of(score: Callable[[Group], float]) -> Measure:
    def mean(rows: Sequence[Row]) -> str:
        values = [score(group) for group in all_groups(rows)]
        return f'{np.mean(values):.2f}' if values else '–'

    return mean


def _first_right(rows: Sequence[Row]) -> str:
    return _share(all(g.right(g.sets[0][0]) for g in groups(row)) for row in rows)


def _sure_and_wrong(rows: Sequence[Row]) -> str:
    return _share(
        not group.right(names)
        for group in all_groups(rows)
        for names, p in group.sets
        if p > 0.9 and not names & NO_NAMES
    )


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
    return all(right_names(effect) & said for effect in row['truth']['effects'])


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
