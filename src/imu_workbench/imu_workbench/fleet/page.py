# SPDX-License-Identifier: Apache-2.0
"""The study of a fleet as one HTML page."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

from markupsafe import Markup

from imu_workbench.case import is_case
from imu_workbench.fleet.figures import (
    MAP_DEVICES,
    control_figure,
    distribution_figure,
    map_figure,
    shortening_figure,
    worst_devices,
)
from imu_workbench.fleet.sources import NO_TYPE
from imu_workbench.fleet.statistics.process_control import LEAST_CPK
from imu_workbench.fleet.statistics.vectors import SENSORS, Vectors, read_vectors
from imu_workbench.fleet.summary import campaign_text, curve_lines, displayed, lot_name
from imu_workbench.fleet.table import FleetTable
from imu_workbench.report.html.render import Section, render_page

MOST_ROWS = 200
"""Rows of a table; the rest stands in study.json."""


def fleet_page(found: Mapping[str, Any], folder: Path, served: str = '') -> str:
    """Return what `study` found in a folder of results as a page.

    Devices are links to their case at `served`, the address of `serve`, or to their folder.
    """
    table = FleetTable(folder)
    sensors = [
        vectors for name in SENSORS if len(vectors := read_vectors(table, name).displayed())
    ]
    sections = [_summary(found)]
    if sensors:
        sections += [_odd(found, table, served), _distributions(sensors), _control(found, sensors)]
    sections.append(_prevalence(found))
    if found['shortening']:
        sections.append(_shortening(found['shortening']))
    subtitle = f'{found["estimated"]} of {found["devices"]} devices estimated'
    return render_page('Fleet', subtitle, sections)


def _summary(found: Mapping[str, Any]) -> Section:
    lots = sorted({lot_name(one) for one in found['populations']})
    facts = {
        'Devices': str(found['devices']),
        'Estimated': str(found['estimated']),
        'Failed': str(len(found['failed'])),
        'Lots': ', '.join(lots) or 'none with enough devices',
        'Outside their lot': str(len({one['device'] for one in found['odd']})),
        'Clusters': ', '.join(str(one['count']) for one in found['clusters']) or '–',
    }
    if found['without_lot']:
        facts['Without a lot'] = f'{found["without_lot"]}, taken as one'
    populations = [
        [
            lot_name(one),
            f'{one["sensor"]} [{one["unit"]}]',
            str(one['devices']),
            *(f'{value:+.3g}' for value in one['mean']),
            *(f'{value:.2g}' for value in one['std']),
            f'{max(one["estimate_std"]):.2g}',
        ]
        for one in displayed(found['populations'])
    ]
    types = [
        [
            'all' if one['type'] == NO_TYPE else one['type'],
            f'{one["sensor"]} [{one["unit"]}]',
            str(one['lots']),
            *(f'{value:+.3g}' for value in one['mean']),
            *(f'{value:.2g}' for value in one['std']),
            f'{max(one["within_std"]):.2g}',
        ]
        for one in displayed(found['types'])
    ]
    clusters = [
        {
            'caption': f'Clusters {"" if one["type"] == "none" else "of type " + one["type"]}',
            'head': ['cluster', *(f'lot {lot}' for lot in next(iter(one['lots'].values()), {}))],
            'rows': [
                [str(int(place) + 1), *(str(count) for count in row.values())]
                for place, row in one['lots'].items()
            ],
        }
        for one in found['clusters']
    ]
    values = {
        'facts': facts,
        'failed': [[d, why] for d, why in list(found['failed'].items())[:MOST_ROWS]],
        'populations': populations,
        'types': types,
        'capability': [_capability(one) for one in displayed(found['capability'])],
        'capable': LEAST_CPK,
        'clusters': clusters,
    }
    return Section('summary', 'Devices and lots', 'fleet_summary.html', values)


def _capability(one: Mapping[str, Any]) -> list[str]:
    low, high = one['interval']
    limits = ('–' if value is None else f'{value:.3g}' for value in (one['lower'], one['upper']))
    return [
        lot_name(one),
        f'{one["sensor"]} {one["axis"]} [{one["unit"]}]',
        str(one['devices']),
        *limits,
        f'{one["cpk"]:.2f}',
        f'{low:.2f} … {high:.2f}',
        'yes' if one['capable'] else 'no',
    ]


def _odd(found: Mapping[str, Any], table: FleetTable, served: str) -> Section:
    odd = found['odd']
    names = sorted({one['device'] for one in odd})
    homes = _homes(table, {*names, *worst_devices(found['scores'])})
    places = {device: _url(device, home, table.folder, served) for device, home in homes.items()}
    rows = [
        [
            one['device'],
            one['lot'],
            one['sensor'],
            one['reason'],
            f'{one["p_value"]:.1e}',
            Markup('<a href="{}">{}</a>').format(places[one['device']], homes[one['device']]),
        ]
        for one in odd[:MOST_ROWS]
    ]
    scores = found['scores']
    shown = min(MAP_DEVICES, len(scores))
    values = {
        'odd_count': len(names),
        'devices': found['estimated'],
        'map_shown': shown,
        'rows': rows,
        'more': f'{len(odd) - MOST_ROWS} more stand in study.json' if len(odd) > MOST_ROWS else '',
    }
    figures = {'fleet_map': map_figure(scores, SENSORS, places)} if shown else {}
    return Section('odd', 'Odd devices', 'fleet_odd.html', values, figures)


def _homes(table: FleetTable, devices: Collection[str]) -> dict[str, str]:
    """Return the folder or URL of the case or the bags of devices."""
    return dict(
        table.rows(
            """SELECT device, any_value(split_part(source, '#', 1)) FROM results
               WHERE device IN (SELECT unnest($names)) GROUP BY device""",
            names=sorted(devices),
        )
    )


def _url(device: str, home: str, page_folder: Path, served: str) -> str:
    """Return the address of a device: its case where it is served, else its folder or URL.

    A folder of this machine is named relative to the page.
    """
    if served and is_case(Path(home)):
        parts = urlsplit(served)
        query = urlencode([*parse_qsl(parts.query), ('device', device)])
        return parts._replace(path=parts.path or '/', query=query).geturl()
    if '://' in home:
        return home
    return quote(os.path.relpath(home, page_folder.resolve())) + '/'


def _distributions(sensors: Sequence[Vectors]) -> Section:
    values = {
        'text': 'Slopes of bias over temperature, as estimated; what is far outside is not drawn.',
        'key': 'fleet_distributions',
        'caption': 'Devices by slope, sensor, axis and lot.',
    }
    figures = {'fleet_distributions': distribution_figure(sensors)}
    return Section('distributions', 'Distributions', 'fleet_figure.html', values, figures)


def _control(found: Mapping[str, Any], sensors: Sequence[Vectors]) -> Section:
    drift = sum(bool(chart['drift_at']) for chart in found['control'])
    values = {
        'text': 'Individuals in the order of lots and of measurement; limits are three standard '
        'deviations by the moving range. Eight in a row on one side of the centre, a sign of '
        f'drift, stand in {drift} of {len(found["control"])} charts.',
        'key': 'fleet_control',
        'caption': 'Control charts by sensor and axis.',
    }
    figures = {'fleet_control': control_figure(sensors, displayed(found['control']))}
    return Section('control', 'Control charts', 'fleet_figure.html', values, figures)


def _prevalence(found: Mapping[str, Any]) -> Section:
    rows = [
        [
            lot_name(one),
            one['sensor'],
            one['effect'],
            one['form'],
            f'{100 * one["share"]:.0f} %',
            f'{100 * one["share_range"][0]:.0f} … {100 * one["share_range"][1]:.0f} %',
            f'{one["alone"]} of {one["devices"]}',
            f'{one["probability"]:.3f}',
        ]
        for one in found['prevalence']
    ]
    shapes = [
        [
            lot_name(one),
            one['sensor'],
            f'{one["effect"]} [{one["unit"]}]',
            *(
                f'{mean:+.2g} ± {std:.2g}'
                for mean, std in zip(one['mean'], one['std'], strict=True)
            ),
            f'{one["median"]:.3g} {one["parameter_unit"]}',
            f'{one["median_range"][0]:.3g} … {one["median_range"][1]:.3g}',
            f'×/÷ {one["factor"]:.2f}',
        ]
        for one in displayed(found['shapes'])
    ]
    values = {'rows': rows, 'shapes': shapes}
    return Section('prevalence', 'Prevalence', 'fleet_prevalence.html', values)


def _shortening(curve: Mapping[str, Any]) -> Section:
    answer = curve_lines(curve)[0].capitalize()
    enough = [
        f'For the {sensor} alone: {campaign_text(own) if own else "none"}. '
        for sensor, own in curve['shortest_of'].items()
        if own != curve['shortest']
    ]
    values = {
        'text': f'{answer}. {"".join(enough)}Error on runs that neither the short nor the full '
        f'campaign has seen; {curve["devices"]} devices; bars: 5 … 95 % of a bootstrap over them.',
        'key': 'fleet_shortening',
        'caption': 'Error of a short calibration over that of the full campaign; dashed: the '
        'bound. A point is a number of temperatures, dwells and poses. One temperature tells no '
        'slope: the mean of the lot stands for it, often off the scale.',
    }
    figures = {'fleet_shortening': shortening_figure(curve)}
    title = 'How short a calibration may be'
    return Section('shortening', title, 'fleet_figure.html', values, figures, 'Shortening')
