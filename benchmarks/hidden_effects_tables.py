# SPDX-License-Identifier: Apache-2.0
"""Tables of what a diagnosis said about campaigns whose truth is known."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.stats import beta
from thermal_comp.effects import EFFECTS

ALARMS = ('effect', 'unexplained', 'unlogged')
COST = 3.0 * np.log(6200.0)
"""What three coefficients cost in evidence over a campaign's block means."""
LIMIT = 0.3
"""Effects whose detection limit is below count at M = 0.3."""
NEAR_FLOOR = 1.05
COVERED = (0.90, 0.99)
"""Between these shares of the stated 95 % intervals are to hold the truth."""
FIRST_ROW_S = {'step_time': 20.0}
"""Fits count from the first row, hidden steps from power-on, a row before it [s]."""

Row = dict[str, Any]


def tables(rows: Sequence[Row]) -> str:
    """Return all tables as text."""
    made = (accuracy, confusion, detection, alarms, beyond, pairs, error_fall, coverage)
    return '\n\n'.join(make(rows) for make in made)


def accuracy(rows: Sequence[Row]) -> str:
    """Say how often the true effect came first, in the set, not at all, or a wrong one did."""
    lines = ['Named (one effect of the catalogue hidden)']
    single = [r for r in rows if r['case'][0] in EFFECTS]
    limits = detection_limits(rows)
    for magnitude in sorted({r['case'][1] for r in single}):
        part = [r for r in single if r['case'][1] == magnitude]
        lines.append(f'  M = {magnitude:g}')
        weak = [r for r in part if limits.get(r['case'][0], 1.0) < LIMIT]
        if magnitude >= 1.0:
            lines.append('    ' + share('first', part, is_first, 0.95))
            lines.append('    ' + share('in the set', part, in_set, 0.98))
        else:
            lines.append('    ' + share('in the set', part, in_set))
            lines.append('    ' + share(f'in the set, limit < {LIMIT:g}', weak, in_set, 0.85))
        lines.append('    ' + share('no wrong name', part, lambda r: not wrong(r), 0.99))
    return '\n'.join(lines)


def confusion(rows: Sequence[Row]) -> str:
    """Say for every effect what was named first, at M of 1 and more."""
    lines = ['Confusion (M ≥ 1): hidden → named first']
    said: dict[str, Counter[str]] = defaultdict(Counter)
    for row in rows:
        if row['case'][0] in EFFECTS and row['case'][1] >= 1.0:
            said[row['case'][0]][first(row)] += 1
    for name in sorted(said):
        answers = ', '.join(f'{answer} {n}' for answer, n in said[name].most_common())
        lines.append(f'  {name:<28} → {answers}')
    return '\n'.join(lines)


def detection(rows: Sequence[Row]) -> str:
    """Say at which magnitude each effect would just be named."""
    lines = ['Detection limits: M at which the evidence reaches its threshold (median), named at']
    limits = detection_limits(rows)
    for name, limit in sorted(limits.items(), key=lambda item: item[1]):
        named = sorted({r['case'][1] for r in rows if r['case'][0] == name and in_set(r)})
        lines.append(f'  {name:<28} {limit:5.2f}   {", ".join(f"{m:g}" for m in named)}')
    return '\n'.join(lines)


def detection_limits(rows: Sequence[Row]) -> dict[str, float]:
    """Return the median M at which evidence + cost, which grows as M², meets the threshold."""
    found: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        name, magnitude, *_ = row['case']
        for finding in row['findings']:
            if name in EFFECTS and finding['name'] == name and finding['threshold']:
                needed = (finding['threshold'] + COST) / (finding['evidence'] + COST)
                found[name].append(magnitude * float(np.sqrt(needed)))
    return {name: float(np.median(values)) for name, values in found.items()}


def alarms(rows: Sequence[Row]) -> str:
    """Say how often something was found where nothing was hidden."""
    lines = ['Nothing hidden']
    nulls = [r for r in rows if not r['truths'] or r['truths'][0]['kind'] == 'nothing']
    for factor in sorted({r['case'][3] for r in nulls}):
        part = [r for r in nulls if r['case'][3] == factor]
        lines.append('  ' + share(f'quiet, bias instability × {factor:g}', part, quiet))
    lines.append('  ' + share('quiet, all', nulls, quiet, 0.99))
    noisy = [r for r in nulls if any(f['kind'] == 'noise' for f in r['findings'])]
    lines.append(f'  noise findings: {len(noisy)} of {len(nulls)}')
    walks = [r for r in rows if r['truths'] and r['truths'][0]['kind'] == 'noise']
    lines.append('  ' + share('random walk called noise', walks, in_set))
    return '\n'.join(lines)


def beyond(rows: Sequence[Row]) -> str:
    """Say what was made of laws beyond the catalogue and of causes that were not logged."""
    lines = ['Beyond the catalogue, or the cause not logged (M = 3)']
    part = [
        r for r in rows if r['truths'] and r['truths'][0]['kind'] in ('unexplained', 'unlogged')
    ]
    lines.append('  ' + share('not given a name', part, flagged, 0.95))
    lines.append('  ' + share('with the right variable', part, right_variable, 0.90))
    off = [row for row in part if not (flagged(row) and right_variable(row))]
    return '\n'.join([*lines, *(f'    {row["case"][0]} → {first(row)}' for row in off)])


def pairs(rows: Sequence[Row]) -> str:
    """Say how often both of two effects were named."""
    part = [r for r in rows if len(r['truths']) == 2]
    lines = [
        'Two effects at once (M = 3 each)',
        '  ' + share('both named', part, both_named, 0.85),
    ]
    off = [row for row in part if not both_named(row)]
    said = [', '.join(answer(finding) for finding in row['findings']) for row in off]
    pairs_off = zip(off, said, strict=True)
    return '\n'.join([*lines, *(f'    {row["case"][0]} → {text}' for row, text in pairs_off)])


def error_fall(rows: Sequence[Row]) -> str:
    """Say how far the held-out error falls when the effect is added."""
    lines = ['Held-out error after adding (M = 3), in noise floors: before, after']
    known = [r for r in rows if r['case'][0] in EFFECTS and r['case'][1] == 3.0]
    fallen = [(r['case'][0], f) for r in known if (f := found(r)) and f['error_after']]
    ratios: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for name, f in fallen:
        ratios[name].append(
            (f['error_before'] / f['noise_floor'], f['error_after'] / f['noise_floor'])
        )
    for name in sorted(ratios):
        before, after = np.median(ratios[name], axis=0)
        lines.append(f'  {name:<28} {before:6.2f} {after:6.3f}')
    near = [{'ratio': after} for values in ratios.values() for _, after in values]
    label = f'within {NEAR_FLOOR - 1:.0%} of the floor'
    lines.append('  ' + share(label, near, lambda r: r['ratio'] <= NEAR_FLOOR, 0.90))
    far = [(name, r) for name in sorted(ratios) for _, r in ratios[name] if r > NEAR_FLOOR]
    return '\n'.join([*lines, *(f'    above: {name} {r:.3f}' for name, r in far)])


def coverage(rows: Sequence[Row]) -> str:
    """Say how often the stated 95 % interval of a shape parameter holds the truth."""
    inside: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        f, magnitude = found(row), row['case'][1]
        if f is None or magnitude < 1.0 or len(row['truths']) != 1:
            continue
        for name, true in row['truths'][0]['parameters'].items():
            stated = (f['parameters'] or {}).get(name)
            if stated is None:
                continue
            since = true - FIRST_ROW_S.get(name, 0.0)
            off = np.abs(np.atleast_1d(stated['value']) - since) / np.atleast_1d(stated['std'])
            inside[f'{row["case"][0]}.{name}'].append({'off': float(off.min())})
    lines = ['Stated 95 % intervals that hold the truth (M ≥ 1)']
    for name in sorted(inside):
        worst = max(r['off'] for r in inside[name])
        lines.append(f'  {share(name, inside[name], covered)}, worst {worst:.1f} σ')
    lines.append('  ' + between('all', [r for part in inside.values() for r in part]))
    return '\n'.join(lines)


def between(label: str, part: Sequence[Row]) -> str:
    """Return how many intervals hold the truth, too few or too many being missed."""
    n, k = len(part), sum(map(covered, part))
    if not n:
        return f'{label}: no campaign yet'
    least = 0.0 if k == 0 else float(beta.ppf(0.05, k, n - k + 1))
    most = 1.0 if k == n else float(beta.ppf(0.95, k + 1, n - k))
    low, high = COVERED
    verdict = 'held' if low * n <= k <= high * n else 'not excluded'
    if most < low or least > high:
        verdict = 'missed'
    return f'{label}: {k} of {n}, {k / n:.0%} (wanted {low:.0%} to {high:.0%}: {verdict})'


def share(
    label: str, part: Sequence[Row], holds: Callable[[Row], bool], bound: float | None = None
) -> str:
    """Return how many hold; a bound is missed when its one-sided 95 % interval excludes it."""
    n, k = len(part), sum(map(holds, part))
    if not n:
        return f'{label}: no campaign yet'
    text = f'{label}: {k} of {n}, {k / n:.0%}'
    if bound is None:
        return text
    upper = 1.0 if k == n else float(beta.ppf(0.95, k + 1, n - k))
    verdict = 'missed' if upper < bound else 'held' if k >= bound * n else 'not excluded'
    return f'{text} (wanted {bound:.0%}: {verdict})'


def answer(finding: Row) -> str:
    """Return one finding in a few words."""
    return finding['name'] or f'{finding["kind"]} ({finding["depends_on"] or "?"})'


def first(row: Row) -> str:
    """Return the strongest answer that counts."""
    said = [f for f in row['findings'] if f['kind'] in ALARMS]
    return answer(said[0]) if said else 'nothing'


def is_first(row: Row) -> bool:
    """Tell whether the true effect is the strongest answer."""
    return first(row) == row['case'][0]


def in_set(row: Row) -> bool:
    """Tell whether the true effect is among what was reported."""
    return row['case'][0] in {
        n for f in row['findings'] for n in (f['name'], *f['ambiguous_with'])
    }


def wrong(row: Row) -> bool:
    """Tell whether an effect was named and the truth is not in the set."""
    return any(f['kind'] == 'effect' for f in row['findings']) and not in_set(row)


def quiet(row: Row) -> bool:
    """Tell whether nothing but noise was reported."""
    return not any(f['kind'] in ALARMS for f in row['findings'])


def flagged(row: Row) -> bool:
    """Tell whether something was found and nothing was named."""
    said = [f for f in row['findings'] if f['kind'] in ALARMS]
    return bool(said) and all(f['name'] is None for f in said)


def right_variable(row: Row) -> bool:
    """Tell whether the variable of the law was named."""
    said = [f for f in row['findings'] if f['kind'] in ALARMS]
    return bool(said) and said[0]['depends_on'] in row['truths'][0]['depends_on']


def both_named(row: Row) -> bool:
    """Tell whether both effects are among what was reported."""
    said = {n for f in row['findings'] for n in (f['name'], *f['ambiguous_with'])}
    return set(row['case'][0].split('+')) <= said


def covered(stated: Row) -> bool:
    """Tell whether the truth is within 1.96 standard deviations."""
    return bool(stated['off'] <= 1.96)


def found(row: Row) -> Row | None:
    """Return the finding that names the true effect."""
    return next((f for f in row['findings'] if f['name'] == row['case'][0]), None)
