# SPDX-License-Identifier: Apache-2.0
"""One self-contained page: sections of HTML, figures as JSON, plotly.js once, no network."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np

from imu_workbench.report.figures.palette import COLOURS
from imu_workbench.report.figures.panels import Figure

SHORTEST_PACKED = 24
"""Length from which a list of numbers is packed into binary."""


@dataclass(frozen=True)
class Section:
    """A part of the page: heading, HTML below it, the figures it shows by key."""

    anchor: str
    title: str
    body: str
    figures: Mapping[str, Figure] = field(default_factory=dict)
    short: str = ''
    """Name in the navigation; '' means the title."""


@dataclass(frozen=True)
class Choice:
    """A selector above a figure."""

    label: str
    options: Sequence[str]


def render_page(title: str, subtitle: str, sections: Sequence[Section]) -> str:
    """Return the page as one HTML text."""
    from plotly.offline import get_plotlyjs

    figures = {key: spec for section in sections for key, spec in section.figures.items()}
    template = Template((files('imu_workbench') / 'report' / 'template.html').read_text('utf-8'))
    return template.substitute(
        title=escape(title),
        subtitle=escape(subtitle),
        navigation=''.join(
            f'<a href="#{s.anchor}">{escape(s.short or s.title)}</a>' for s in sections
        ),
        body='\n'.join(
            f'<section id="{s.anchor}" aria-labelledby="{s.anchor}-title">'
            f'<h2 id="{s.anchor}-title">{escape(s.title)}</h2>{s.body}</section>'
            for s in sections
        ),
        plotly=get_plotlyjs().replace('</script', '<\\/script'),
        figures=json_for_page(figures),
        colours=json_for_page(COLOURS),
    )


def json_for_page(value: Any) -> str:
    """Return JSON that may stand inside a script element; long lists of numbers are packed."""
    text = json.dumps(packed(value), ensure_ascii=False, separators=(',', ':'), allow_nan=False)
    return text.replace('</', '<\\/').replace('<!--', '<\\!--')


def packed(value: Any) -> Any:
    """Return the value with long lists of numbers as base64 of float32, as plotly.js reads them.

    >>> packed({'x': [0.0, 1.0] * 12})['x']['dtype']
    'f4'
    """
    if isinstance(value, Mapping):
        return {key: packed(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        if len(value) >= SHORTEST_PACKED and all(
            item is None or isinstance(item, int | float) for item in value
        ):
            numbers = np.array(value, dtype=np.float32)
            return {'dtype': 'f4', 'bdata': base64.b64encode(numbers.tobytes()).decode()}
        return [packed(item) for item in value]
    return value


def figure_html(key: str, caption: str, label: str) -> str:
    """Return the place of one figure with its caption."""
    return (
        f'<figure><div class="plot" data-figure="{escape(key)}" role="img" '
        f'aria-label="{escape(label)}"></div><figcaption>{caption}</figcaption></figure>'
    )


def group_html(
    name: str, choices: Sequence[Choice], caption: str, label: str, *, parts: str = ''
) -> str:
    """Return selectors with the figure `name|option|…` they choose, and the `parts` below.

    Elements of `parts` with data-key="option|…" are shown with their choice only.
    """
    selects = ''.join(
        f'<label>{escape(choice.label)}<select>'
        + ''.join(f'<option>{escape(option)}</option>' for option in choice.options)
        + '</select></label>'
        for choice in choices
    )
    figure = figure_html('', caption, label) if label else ''
    return (
        f'<div data-group="{escape(name)}"><div class="controls">{selects}</div>'
        f'{figure}{parts}</div>'
    )


def table_html(
    head: Sequence[Sequence[str]],
    rows: Sequence[Sequence[str]],
    *,
    caption: str = '',
    key: str = '',
    text_columns: Sequence[int] = (),
    dense: bool = False,
) -> str:
    """Return a table; the first cell of a row is its heading, cells are HTML.

    A head cell 'text|n' spans n columns.
    """
    shown_head = ''.join(
        f'<tr>{"".join(_head_cell(cell, i in text_columns) for i, cell in enumerate(row))}</tr>'
        for row in head
    )
    body = ''.join(
        f'<tr><th scope="row">{row[0]}</th>'
        + ''.join(
            f'<td class="text wrap">{cell}</td>' if i in text_columns else f'<td>{cell}</td>'
            for i, cell in enumerate(row[1:], 1)
        )
        + '</tr>'
        for row in rows
    )
    look = ' class="dense"' if dense else ''
    mark = f' data-key="{escape(key)}"' if key else ''
    title = f'<div class="caption">{caption}</div>' if caption else ''
    return (
        f'<div class="table"{mark}>{title}<div class="scroll" tabindex="0" role="region" '
        f'aria-label="{escape(re.sub("<.*?>", "", caption)) or "table"}"><table{look}>'
        f'<thead>{shown_head}</thead><tbody>{body}</tbody></table></div></div>'
    )


def _head_cell(text: str, over_text: bool) -> str:
    label, separator, span = text.rpartition('|')
    if separator and span.isdigit():
        return f'<th scope="colgroup" colspan="{span}" class="edge">{label}</th>'
    look = ' class="text"' if over_text else ''
    return f'<th scope="col"{look}>{text}</th>'


def pairs_html(pairs: Mapping[str, str]) -> str:
    """Return names and values as a list; values are HTML."""
    items = ''.join(f'<dt>{escape(name)}</dt><dd>{value}</dd>' for name, value in pairs.items())
    return f'<dl class="pairs">{items}</dl>'
