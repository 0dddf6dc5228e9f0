# SPDX-License-Identifier: Apache-2.0
"""The study of a fleet in the units of display, and as lines for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from thermal_comp.presentation.display import coefficient_unit

from imu_workbench.fleet.sources import NO_TYPE
from imu_workbench.fleet.statistics.process_control import LEAST_CPK

AXIS_VALUES = ('mean', 'std', 'estimate_std', 'within_std')
BOUND_VALUES = ('lower', 'upper', 'centre')
MOST_LISTED = 20
"""Odd or failed devices, and slopes beyond limits, that are listed; all stand in the JSON."""

SAME_RATIO = 5e-4
"""Ratios closer than this are the same: the longer campaign is not listed."""


def lot_name(one: Mapping[str, Any]) -> str:
    """Return the lot of an entry, with its type where it has one.

    >>> lot_name({'lot': 'A', 'type': 'LSM9DS1'})
    'A of type LSM9DS1'
    """
    return str(one['lot']) if one['type'] == NO_TYPE else f'{one["lot"]} of type {one["type"]}'


def failed_lines(failed: Mapping[str, str]) -> list[str]:
    """Return a line per device that has no estimate, with its reason."""
    lines = [
        f'failed: {device}: {reason}' for device, reason in list(failed.items())[:MOST_LISTED]
    ]
    if len(failed) > MOST_LISTED:
        lines.append(f'and {len(failed) - MOST_LISTED} failed more')
    return lines


def study_lines(found: Mapping[str, Any]) -> list[str]:
    """Return a line per lot, cluster, named effect and odd device."""
    lines = []
    if found['without_lot']:
        count = found['without_lot']
        have = 'device has no lot' if count == 1 else 'devices have no lot and are taken as one'
        lines.append(f'warning: {count} {have}: name it in the path (lot=A) or in a list')
    if found['other_version']:
        lines.append(
            f'warning: {found["other_version"]} devices were estimated by another version: give '
            'their bags to `fleet` again'
        )
    for one in displayed(found['populations']):
        mean = ', '.join(f'{value:+.3g}' for value in one['mean'])
        std = ', '.join(f'{value:.2g}' for value in one['std'])
        lines.append(
            f'lot {lot_name(one)} {one["sensor"]}: slopes {mean} ± {std} {one["unit"]} '
            f'({one["devices"]} devices)'
        )
    for one in displayed(found['types']):
        mean = ', '.join(f'{value:+.3g}' for value in one['mean'])
        std = ', '.join(f'{value:.2g}' for value in one['std'])
        kind = 'all' if one['type'] == NO_TYPE else f'type {one["type"]}'
        lines.append(
            f'{kind} {one["sensor"]}: slopes of lots {mean} ± {std} {one["unit"]} from lot to lot '
            f'({one["lots"]} lots)'
        )
    missed = [one for one in found['capability'] if not one['capable']]
    lines += [capability_line(one) for one in missed[:MOST_LISTED]]
    if len(missed) > MOST_LISTED:
        lines.append(f'and {len(missed) - MOST_LISTED} slopes more')
    for one in found['clusters']:
        kind = '' if one['type'] == NO_TYPE else f' of type {one["type"]}'
        lines.append(f'clusters{kind}: {one["count"]}')
    lines += [prevalence_line(one) for one in found['prevalence'] if one['named']]
    lines += [shape_line(one) for one in displayed(found['shapes'])]
    if found['shortening']:
        lines += curve_lines(found['shortening'])[:1]
    odd = found['odd']
    lines += [
        f'odd: {one["device"]} {one["sensor"]}: {one["reason"]}' for one in odd[:MOST_LISTED]
    ]
    if len(odd) > MOST_LISTED:
        lines.append(f'and {len(odd) - MOST_LISTED} more')
    return lines


def capability_line(one: Mapping[str, Any]) -> str:
    """Return how well a lot keeps the limits of one slope."""
    low, high = one['interval']
    return (
        f'lot {lot_name(one)} {one["sensor"]} {one["axis"]}: {one["coefficient"]} has Cpk '
        f'{one["cpk"]:.2f} ({low:.2f} … {high:.2f}); {LEAST_CPK} is wanted'
    )


def prevalence_line(one: Mapping[str, Any]) -> str:
    """Return the prevalence of one effect in words."""
    low, high = (100.0 * value for value in one['share_range'])
    return (
        f'{one["effect"]} in the {one["sensor"]} of {100 * one["share"]:.0f} % of lot '
        f'{lot_name(one)} ({low:.0f} … {high:.0f} %); {one["alone"]} of {one["devices"]} devices '
        'show it alone'
    )


def shape_line(one: Mapping[str, Any]) -> str:
    """Return coefficients and shape of an effect in the devices of a lot that have it."""
    pairs = zip('xyz', one['mean'], one['std'], strict=False)
    coefficients = ', '.join(f'{axis} {mean:+.2g} ± {std:.2g}' for axis, mean, std in pairs)
    low, high = one['median_range']
    return (
        f'lot {lot_name(one)} {one["sensor"]}: {one["effect"]} {coefficients} {one["unit"]}; '
        f'{one["parameter"]} {one["median"]:.3g} {one["parameter_unit"]} ({low:.3g} … {high:.3g}) '
        f'×/÷ {one["factor"]:.2f} from device to device'
    )


def curve_lines(curve: Mapping[str, Any]) -> list[str]:
    """Return how short a calibration may be: for all sensors, for each, and the way there."""
    shortest, bound = curve['shortest'], curve['good_enough']
    if shortest:
        first = (
            f'short calibration: {campaign_text(shortest)} instead of {curve["full_hours"]:.2f} h '
            f'reach {shortest["ratio"]:.2f} × the error of the full campaign in the worst sensor '
            f'({shortest["upper"]:.2f} with 95 %; {bound:g} is the bound)'
        )
    else:
        first = f'short calibration: none reaches {bound:g} × the error of the full campaign'
    lines = [first]
    for sensor, own in curve['shortest_of'].items():
        enough = campaign_text(own) if own else 'none'
        lines.append(f'{sensor}: enough is {enough}')
        for point in shortest_first(curve['points'], sensor):
            low, high = point['ratio_range']
            lines.append(
                f'  {campaign_text(point)}: {point["ratio"]:.3f} ({low:.3f} … {high:.3f})'
            )
    return lines


def campaign_text(one: Mapping[str, Any]) -> str:
    """Return temperatures, poses and hours of a short campaign in words.

    >>> campaign_text({'temperatures': 3, 'poses': 1, 'hours': 0.4, 'share': 0.5})
    '3 temperatures in 1 pose, 1/2 of the dwells, 0.40 h'
    """
    share = '' if one['share'] == 1.0 else f', 1/{1.0 / one["share"]:.0f} of the dwells'
    counts = (
        f'{one[name]} {name if one[name] > 1 else name[:-1]}' for name in ('temperatures', 'poses')
    )
    return f'{" in ".join(counts)}{share}, {one["hours"]:.2f} h'


def shortest_first(
    points: Iterable[Mapping[str, Any]], sensor: str, *, prior: bool = True
) -> list[Mapping[str, Any]]:
    """Return the campaigns of a sensor than which no shorter one is better."""
    own = [p for p in points if (p['sensor'], p['prior']) == (sensor, prior)]
    front: list[Mapping[str, Any]] = []
    for point in sorted(own, key=lambda p: (p['hours'], p['ratio'])):
        if not front or point['ratio'] < front[-1]['ratio'] - SAME_RATIO:
            front.append(point)
    return front


def displayed(entries: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return entries of a study with their coefficients, axes x, y, z, in the unit of display.

    >>> displayed([{'sensor': 'accelerometer', 'unit': 'm/s²/K', 'mean': [0.004, 0.0, -0.002]}])
    [{'sensor': 'accelerometer', 'unit': 'mm/s²/K', 'mean': [4.0, 0.0, -2.0]}]
    """
    return [_displayed(entry) for entry in entries]


def _displayed(entry: Mapping[str, Any]) -> dict[str, Any]:
    unit = coefficient_unit(entry['sensor'], entry['unit'])
    scaled = partial(_scaled, unit.factor)
    changed = {key: scaled(entry[key][:3]) for key in AXIS_VALUES if key in entry}
    bounds = {key: scaled([entry[key]])[0] for key in BOUND_VALUES if key in entry}
    limits = {'limits': scaled(entry['limits'])} if 'limits' in entry else {}
    return {**entry, **changed, **bounds, **limits, 'unit': unit.unit}


def _scaled(factor: float, values: Sequence[float | None]) -> list[float | None]:
    return [None if value is None else factor * value for value in values]
