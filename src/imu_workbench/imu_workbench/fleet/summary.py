# SPDX-License-Identifier: Apache-2.0
"""What a terminal shows of the study of a fleet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SHOWN = 20
"""Odd devices that are listed; all stand in the JSON and on the page."""


def study_lines(found: Mapping[str, Any]) -> list[str]:
    """Return a line per lot, cluster, named effect and odd device."""
    lines = []
    if found['without_lot']:
        lines.append(
            f'warning: {found["without_lot"]} devices have no lot and are taken as one: '
            'name it in the path (lot=A) or in a list'
        )
    for one in found['populations']:
        mean = ', '.join(f'{value:+.3g}' for value in one['mean'])
        std = ', '.join(f'{value:.2g}' for value in one['std'])
        lines.append(
            f'lot {one["lot"]} {one["sensor"]}: slopes {mean} ± {std} {one["unit"]} '
            f'({one["devices"]} devices)'
        )
    for one in found['clusters']:
        kind = '' if one['type'] == 'none' else f' of type {one["type"]}'
        lines.append(f'clusters{kind}: {one["count"]}')
    lines += [prevalence_line(one) for one in found['prevalence'] if one['named']]
    odd = found['odd']
    lines += [f'odd: {one["device"]} {one["sensor"]}: {one["reason"]}' for one in odd[:SHOWN]]
    if len(odd) > SHOWN:
        lines.append(f'and {len(odd) - SHOWN} more')
    return lines


def prevalence_line(one: Mapping[str, Any]) -> str:
    """Return the prevalence of one effect in words."""
    low, high = (100.0 * value for value in one['share_range'])
    return (
        f'{one["effect"]} in the {one["sensor"]} of {100 * one["share"]:.0f} % of lot '
        f'{one["lot"]} ({low:.0f} … {high:.0f} %); {one["alone"]} of {one["devices"]} devices '
        'show it alone'
    )
