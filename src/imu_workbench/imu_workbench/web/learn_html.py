# SPDX-License-Identifier: Apache-2.0
"""Findings, effects and proposals in words and bars."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from math import log
from typing import Any

from thermal_comp.experiment_design import SEPARABLE

from imu_workbench.display import DISPLAY_UNITS, fixed, shown, with_uncertainty
from imu_workbench.web.fingerprint import Fingerprint

FALLS = {
    'held-out error before': 'error_before',
    'held-out error after': 'error_after',
    'noise floor': 'noise_floor',
}
"""Label → key of a finding."""


def finding_html(finding: Mapping[str, Any]) -> str:
    """Return evidence, errors, parameters and rivals of a finding as a table."""
    rows = [('evidence', evidence_text(finding['evidence'], finding['threshold']))]
    sensor, falls = finding['sensor'].split('+')[0], ''
    if finding['error_after'] is not None and sensor in DISPLAY_UNITS:
        unit = DISPLAY_UNITS[sensor]
        falls = falls_html(
            {
                label: None if finding[key] is None else finding[key] * unit.factor
                for label, key in FALLS.items()
            },
            unit.unit,
        )
    for name, value in finding['parameters'].items():
        text = parameter_text(value['value'], value.get('std'))
        rows.append((name.replace('_', ' '), f'{text} {value["unit"]}'))
    if finding['rivals']:
        text = ', '.join(
            f'{r["name"].replace("_", " ")} {percent(r["similarity"])}'
            for r in finding['rivals'][:3]
        )
        rows.append(('rivals would explain', text))
    return falls + pairs_html(rows)


def evidence_text(evidence: float, threshold: float) -> str:
    """Return the evidence, and what is needed where that is known."""
    needed = f' (needed {fixed(threshold, 0)})' if threshold > 0.0 else ''
    return f'{fixed(evidence, 0)}{needed}'


def percent(share: float) -> str:
    """Return a share in percent."""
    return f'{fixed(100.0 * share, 0)}\N{NARROW NO-BREAK SPACE}%'


def finding_text(finding: Mapping[str, Any]) -> str:
    """Return the finding's sentence with names as people write them."""
    text = str(finding['text'])
    for name in (finding['name'], *finding['ambiguous_with']):
        if name:
            text = text.replace(name, name.replace('_', ' '))
    return text


def falls_html(values: Mapping[str, float | None], unit: str) -> str:
    """Return held-out error before, after, and the floor as bars on a logarithmic scale."""
    known = [value for value in values.values() if value and value > 0.0]
    if not known:
        return ''
    low, high = min(known) / 3.0, max(known)
    rows = ''
    for label, value in values.items():
        share = 100.0 * log(max(value or low, low) / low) / log(high / low)
        kind = label.rpartition(' ')[2]
        rows += (
            f'<span class="label">{label}</span><span class="line {kind}">'
            f'<span style="width:{share:.0f}%"></span></span>'
            f'<span class="number">{shown(value)} {unit}</span>'
        )
    return f'<div class="falls">{rows}</div>'


def parameter_text(value: Any, std: Any) -> str:
    """Return value ± standard deviation, or a list of them."""
    if isinstance(value, list):
        spread = std if isinstance(std, list) else [None] * len(value)
        return ', '.join(with_uncertainty(v, s) for v, s in zip(value, spread, strict=True))
    if isinstance(std, list):
        std = std[0] if std else None
    return with_uncertainty(value, std)


def explanation_html(told: Mapping[str, Any]) -> str:
    """Return an effect in words."""
    rows = [
        ('mechanism', told['mechanism']),
        ('to tell it apart', told['separation']),
        ('typical size', told['typical_size']),
        ('acts on', ', '.join(told['sensors'])),
        ('needs', ', '.join(told['channels']) or 'nothing beyond temperature and time'),
        ('reference', told['reference']),
    ]
    return (
        f'<p>{escape(told["summary"])}</p><p class="equation">{escape(told["equation"])}</p>'
        + pairs_html(rows)
    )


def fingerprint_html(found: Fingerprint, axis: int) -> str:
    """Return in a sentence what the effect would explain."""
    shape = ', '.join(
        f'{name.replace("_", " ")} {parameter_text(value["value"], None)} {value["unit"]}'
        for name, value in found.parameters.items()
    )
    return (
        f'<p>Evidence {evidence_text(found.evidence, found.threshold)}; explains '
        f'{percent(found.share[axis])} of the variance of the residual of this axis'
        f'{"; " + escape(shape) if shape else ""}.</p>'
    )


def proposal_html(proposal: Mapping[str, Any]) -> str:
    """Return what the next experiment promises."""
    one, other = (name.replace('_', ' ') for name in proposal['effects'])
    before, after = proposal['evidence_before'], proposal['evidence_after']
    evidence = (
        f'{shown(before)} with the plan of the paper, {shown(after)} with this one '
        f'(needed {fixed(SEPARABLE, 0)})'
    )
    verdict = 'separable' if proposal['separable'] else 'not separable by temperature alone'
    rows = [
        ('question', f'{one} or {other} in the {proposal["sensor"]}'),
        ('answer', verdict),
        ('evidence', evidence),
        ('length', f'{proposal["repeats"]} cycles, {proposal["hours"]:.1f} h a run'),
        *(('do', action) for action in proposal['actions']),
    ]  # fmt: skip
    return pairs_html(rows)


def pairs_html(rows: list[tuple[str, str]]) -> str:
    """Return names and values as a list."""
    items = ''.join(f'<dt>{escape(name)}</dt><dd>{escape(text)}</dd>' for name, text in rows)
    return f'<dl class="pairs">{items}</dl>'
