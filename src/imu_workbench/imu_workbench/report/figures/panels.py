# SPDX-License-Identifier: Apache-2.0
"""Layout of a figure: panels in a grid on a screen, one below the other on a phone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

Figure = dict[str, Any]
"""Plotly specification: data, layout, and `narrow`, what a phone's layout changes."""

TOP_PX, BOTTOM_PX = 52, 50
"""Margins above (legend, title) and below (ticks, axis title) the panels [px]."""
TOOLBAR_PX = 32
"""Height of plotly's toolbar in the upper right corner [px]."""
BESIDE_TOOLBAR_PX = 620
"""Width of a legend that has room beside the toolbar; a wider one stands below it [px]."""
COLUMN_GAP = 0.075
"""Share of the width between two columns."""


@dataclass(frozen=True)
class Panel:
    """One coordinate system of a figure."""

    x_title: str
    y_title: str
    title: str = ''
    x: dict[str, Any] = field(default_factory=dict)
    """Further properties of the x axis."""
    y: dict[str, Any] = field(default_factory=dict)
    right_title: str = ''
    """Title of a second y axis on the right; '' for none."""


def trace_axes(index: int, *, right: bool = False) -> dict[str, str]:
    """Return the axis references of a trace in the index-th panel.

    >>> trace_axes(0), trace_axes(1, right=True)
    ({'xaxis': 'x', 'yaxis': 'y'}, {'xaxis': 'x3', 'yaxis': 'y4'})
    """
    return {
        'xaxis': f'x{_number(2 * index + 1)}',
        'yaxis': f'y{_number(2 * index + (2 if right else 1))}',
    }


def figure(
    data: Sequence[dict[str, Any]],
    panels: Sequence[Panel],
    *,
    columns: int = 1,
    height: int = 210,
    linked: bool = True,
    annotations: Sequence[dict[str, Any]] = (),
    **layout: Any,
) -> Figure:
    """Return a figure of panels of `height` pixels in rows of `columns`.

    `linked` panels show the same x range; in one column only the lowest is labelled then.
    """
    stacked = linked and columns == 1
    right = any(panel.right_title for panel in panels)
    wide = _Grid(len(panels), columns, height, 26 if stacked else 76)
    narrow = _Grid(len(panels), 1, height, 26 if stacked else 76)
    extra = _legend_height(data, 300)
    below = TOOLBAR_PX if _legend_height(data, BESIDE_TOOLBAR_PX) else 0
    look = _look()
    spec = look | {
        'height': wide.total + below,
        'margin': {'l': 70, 'r': 64 if right else 16, 't': TOP_PX + below, 'b': BOTTOM_PX},
        'legend': look['legend'] | {'y': 1.0 - below / (wide.total + below)},
        'annotations': [*annotations, *_titles(panels, wide)],
        **layout,
    }
    small: dict[str, Any] = {
        'height': narrow.total + extra,
        'margin': {'l': 56, 'r': 48 if right else 8, 't': TOP_PX + extra, 'b': BOTTOM_PX},
        'font': {'size': 11},
        'legend': {'y': 1},  # a phone shows no toolbar
        'annotations': [*annotations, *_titles(panels, narrow)],
    }
    for i, panel in enumerate(panels):
        unlabelled = stacked and i < len(panels) - 1
        names = (f'xaxis{_number(2 * i + 1)}', f'yaxis{_number(2 * i + 1)}')
        spec[names[0]] = _axis('' if unlabelled else panel.x_title) | {
            'domain': wide.domain(i)[0],
            'anchor': names[1].replace('axis', ''),
            'showticklabels': not unlabelled,
            **({'matches': 'x'} if linked and i else {}),
            **panel.x,
        }
        spec[names[1]] = _axis(panel.y_title) | {
            'domain': wide.domain(i)[1],
            'anchor': names[0].replace('axis', ''),
            **panel.y,
        }
        small[names[0]] = {'domain': narrow.domain(i)[0]}
        small[names[1]] = {'domain': narrow.domain(i)[1]}
        if panel.right_title:
            spec[f'yaxis{2 * i + 2}'] = _axis(panel.right_title) | {
                'overlaying': names[1].replace('axis', ''),
                'anchor': names[0].replace('axis', ''),
                'side': 'right',
                'showgrid': False,
                'tickmode': 'auto',
                'nticks': 5,
                'tickfont': {'color': '@temperature'},
                'title': {'text': panel.right_title, 'font': {'color': '@temperature'}},
            }
    return {'data': list(data), 'layout': spec, 'narrow': small}


def _legend_height(data: Sequence[dict[str, Any]], width: int) -> int:
    """Return what the legend's rows after the first take on a page of `width` [px].

    Entries stand in columns; groups follow each other as they fit, with a gap between rows.
    """
    entries = [t for t in data if t.get('name') and t.get('showlegend', True)]
    if not any(t.get('legendgroup') for t in entries):
        columns = max(1, width // (48 + 6 * max((len(t['name']) for t in entries), default=0)))
        return 19 * max(0, -(-len(entries) // columns) - 1)
    rows, left = 1, float(width)
    for size in (56 + 6.5 * len(t['name']) for t in entries):
        if size > left and left < width:
            rows, left = rows + 1, width
        left -= size
    return 29 * (rows - 1)


class _Grid:
    """Places of panels in a grid, as shares of the plotting area."""

    def __init__(self, panels: int, columns: int, height: int, gap: int) -> None:
        self.columns = min(columns, panels)
        self.rows = -(-panels // self.columns)
        self.inner = self.rows * height + (self.rows - 1) * gap
        self.height, self.gap = height, gap
        self.total = self.inner + TOP_PX + BOTTOM_PX

    def domain(self, index: int) -> tuple[list[float], list[float]]:
        row, column = divmod(index, self.columns)
        width = (1.0 - COLUMN_GAP * (self.columns - 1)) / self.columns
        left = column * (width + COLUMN_GAP)
        top = 1.0 - row * (self.height + self.gap) / self.inner
        bottom = max(0.0, top - self.height / self.inner)
        return [round(left, 4), round(left + width, 4)], [round(bottom, 4), round(top, 4)]


def _titles(panels: Sequence[Panel], grid: _Grid) -> list[dict[str, Any]]:
    titles = []
    for i, panel in enumerate(panels):
        if panel.title:
            x, y = grid.domain(i)
            titles.append({
                'text': f'<b>{panel.title}</b>', 'x': x[0], 'y': y[1], 'xref': 'paper',
                'yref': 'paper', 'xanchor': 'left', 'yanchor': 'bottom', 'showarrow': False,
                'font': {'color': '@soft', 'size': 12},
            })  # fmt: skip
    return titles


def _look() -> dict[str, Any]:
    return {
        'paper_bgcolor': '@panel',
        'plot_bgcolor': '@panel',
        'font': {'color': '@text', 'size': 12.5, 'family': 'system-ui, sans-serif'},
        'hoverlabel': {'bgcolor': '@tip', 'bordercolor': '@axis', 'font': {'color': '@text'}},
        'legend': {'orientation': 'h', 'x': 0, 'xanchor': 'left', 'y': 1, 'yref': 'container',
                   'yanchor': 'top', 'bgcolor': '@panel', 'itemsizing': 'constant'},
        'hovermode': 'closest',
        'bargap': 0.02,
        'dragmode': 'zoom',
        'modebar': {'bgcolor': '@panel', 'color': '@axis', 'activecolor': '@text'},
    }  # fmt: skip


def _axis(title: str) -> dict[str, Any]:
    return {
        'title': {'text': title, 'standoff': 8},
        'gridcolor': '@grid',
        'linecolor': '@axis',
        'zeroline': False,
        'showline': True,
        'ticks': 'outside',
        'tickcolor': '@axis',
        'ticklen': 4,
        'automargin': False,
        'exponentformat': 'power',
    }


def _number(index: int) -> str:
    return '' if index == 1 else str(index)
