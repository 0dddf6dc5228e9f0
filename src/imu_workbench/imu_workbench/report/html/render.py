# SPDX-License-Identifier: Apache-2.0
"""One self-contained page: sections from templates, figures as JSON, plotly.js, no network."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from imu_workbench.report.figures.palette import COLOURS
from imu_workbench.report.figures.panels import Figure

LEAST_PACKED_LENGTH = 24
"""Length from which a list of numbers is packed into binary."""
PACKED_ITEM_TYPES = frozenset({float, int, type(None)})
"""Types of the items of a list that may be packed."""
Row = list[str]
"""Cells of a table's row as text; the first is the row's heading."""


@dataclass(frozen=True)
class Section:
    """A part of the page: a heading, the template below it with its values, its figures by key."""

    anchor: str
    title: str
    template: str
    values: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    short: str = ''
    """Name in the navigation; '' means the title."""

    def body(self) -> Markup:
        """Return the HTML below the heading."""
        return Markup(templates().get_template(self.template).render(self.values))  # noqa: S704


def figure_of_paper(content: Mapping[str, Any], number: int) -> str:
    """Return which figure of the paper a caption is about; '' where its campaign was not run."""
    return f'Fig. {number}. ' if content['follows_paper'] else ''


@cache
def templates() -> Environment:
    """Return the templates of the page; every value put into one is escaped."""
    return Environment(
        loader=PackageLoader('imu_workbench', 'report/html/templates'),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )


def render_page(title: str, subtitle: str, sections: Sequence[Section]) -> str:
    """Return the page as one HTML text."""
    from plotly.offline import get_plotlyjs

    figures = {key: spec for section in sections for key, spec in section.figures.items()}
    return (
        templates()
        .get_template('page.html')
        .render(
            title=title,
            subtitle=subtitle,
            sections=sections,
            plotly=compressed(get_plotlyjs()),
            figures=compressed(json_for_page(figures)),
            colours=json_for_page(COLOURS),
        )
    )


def compressed(text: str) -> str:
    """Return the text as base64 of gzip, as the page unpacks it: plotly.js alone is 5 MB."""
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()


def json_for_page(value: Any) -> Markup:
    """Return JSON that may stand inside a script element; long lists of numbers are packed."""
    text = json.dumps(packed(value), ensure_ascii=False, separators=(',', ':'), allow_nan=False)
    return Markup(text.replace('</', '<\\/').replace('<!--', '<\\!--'))  # noqa: S704


def packed(value: Any) -> Any:
    """Return the value with long lists of numbers as base64 of float32, as plotly.js reads them.

    >>> packed({'x': [0.0, 1.0] * 12})['x']['dtype']
    'f4'
    """
    if isinstance(value, Mapping):
        return {key: packed(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        if len(value) >= LEAST_PACKED_LENGTH and PACKED_ITEM_TYPES.issuperset(map(type, value)):
            numbers = np.array(value, dtype=np.float32)
            return {'dtype': 'f4', 'bdata': base64.b64encode(numbers.tobytes()).decode()}
        return [packed(item) for item in value]
    return value
