# SPDX-License-Identifier: Apache-2.0
"""Measured and modelled error over time with the temperature, and the residual below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.presentation.display import DISPLAY_UNITS

from imu_workbench.report.figures.measured import curve
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.report.series import decimated, rounded
from imu_workbench.web.case.preview import EffectPreview
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import Timeline, View, inside_window, timeline_of

LINE_NAMES = ('measured', 'modelled', 'temperature', 'earlier', 'residual', 'candidate', 'left')
"""What is drawn, in the order of the traces."""
Lines = dict[str, dict[str, list[float | None]]]
"""Name → {'x': hours on the timeline, 'y': display units}; in the order of LINE_NAMES."""
MAX_CURSOR_ROWS = 2400
"""Blocks that one cursor knows in all figures."""
GAP_STEPS = 5.0
"""Usual distances of block means from which a line is broken."""


def time_lines(
    bags: Sequence[StoredBag],
    version: Version | None,
    view: View,
    window: tuple[float, float] | None = None,
    earlier: Version | None = None,
    preview: EffectPreview | None = None,
) -> Lines:
    """Return all lines of the figure within a window of the timeline [h]; None: everything.

    `preview`: an effect's part of the residual is drawn over it, and what would be left.
    """
    timeline = timeline_of(bags)
    shown = window or (0.0, timeline.end)
    factor = DISPLAY_UNITS[view.sensor].factor
    blocks = {run.run: run for run in version.blocks} if version else {}
    older = {run.run: run for run in earlier.blocks} if earlier else {}
    parts: dict[str, list[tuple[FloatArray, FloatArray]]] = {name: [] for name in LINE_NAMES}
    for bag in bags:
        start = timeline.start(bag.run)
        inside = ((shown[0] - start) * 3600.0, (shown[1] - start) * 3600.0)
        if inside[1] < 0.0 or inside[0] > bag.duration:
            continue
        share = min(1.0, bag.duration / 3600.0 / max(shown[1] - shown[0], 1e-9))
        run = blocks.get(bag.run)
        time, values = sample_line(
            bag, view.sensor, view.axis, inside, max(400, int(share * LINE_POINTS))
        )
        level = run.level[view.sensor][view.axis] if run else _middle(values)
        parts['measured'].append((start + time / 3600.0, (values - level) * factor))
        time, values = temperature_line(bag, inside)
        parts['temperature'].append((start + time / 3600.0, values))
        if run:
            x = start + run.time / 3600.0
            parts['modelled'] += unbroken(x, run.modelled[view.sensor][:, view.axis] * factor)
            left = run.residual(view.sensor)[:, view.axis] * factor
            parts['residual'] += unbroken(x, left)
            if preview is not None and bag.run in preview.curves:
                explained = preview.curves[bag.run][:, view.axis] * factor
                parts['candidate'] += unbroken(x, explained)
                parts['left'] += unbroken(x, left - explained)
        if bag.run in older:
            past = older[bag.run]
            x = start + past.time / 3600.0
            parts['earlier'] += unbroken(x, past.residual(view.sensor)[:, view.axis] * factor)
    return {name: _joined(pieces) for name, pieces in parts.items()}


def time_figure(
    bags: Sequence[StoredBag],
    version: Version | None,
    view: View,
    earlier: Version | None = None,
    preview: EffectPreview | None = None,
) -> Figure:
    """Return the figure; zoomed to the view's place or window."""
    timeline = timeline_of(bags)
    window = view.window
    if window is None and version and view.place:
        window = timeline.span(version.blocks, view.place)
    lines = time_lines(bags, version, view, window, earlier, preview)
    panels = [
        Panel('time [h]', f'error {view.axis_name} [{DISPLAY_UNITS[view.sensor].unit}]',
              right_title='die [°C]', y={'fixedrange': True}),
        Panel(_time_title(timeline), f'residual [{DISPLAY_UNITS[view.sensor].unit}]',
              y={'fixedrange': True}),
    ]  # fmt: skip
    spec = figure(
        _traces(lines, view, earlier, preview), panels, columns=1, height=200,
        shapes=_shapes(version, view, timeline),
    )  # fmt: skip
    layout = spec['layout']
    layout['annotations'] = spec['narrow']['annotations'] = _marks(timeline)
    layout['xaxis']['range'] = list(window or (-0.01 * timeline.end, 1.01 * timeline.end))
    layout['hovermode'] = 'x'
    runs = {'runs': list(timeline.runs), 'starts': list(timeline.starts)}
    layout['meta'] = cursor_rows(version, view, timeline, window) | runs
    return spec


def _traces(
    lines: Lines, view: View, earlier: Version | None, preview: EffectPreview | None
) -> list[dict[str, Any]]:
    unit = DISPLAY_UNITS[view.sensor].unit
    above, below = trace_axes(0), trace_axes(1)
    hover = f'%{{y:.4~g}} {unit} at %{{x:.3f}} h<extra></extra>'
    name = preview.effect.replace('_', ' ') if preview else 'candidate'
    return [
        curve(lines['measured'], 'measured', above, color='@raw_soft', width=3,
              hovertemplate='measured ' + hover),
        curve(lines['modelled'], 'modelled', above, color='@model', width=1.3,
              hovertemplate='modelled ' + hover),
        curve(lines['temperature'], 'die temperature', trace_axes(0, right=True),
              color='@temperature', width=1.2, dash='dot',
              hovertemplate='die %{y:.2f} °C at %{x:.3f} h<extra></extra>'),
        curve(lines['earlier'], 'residual of the version before', below, color='@raw_soft',
              width=1, showlegend=earlier is not None, hovertemplate='before ' + hover),
        curve(lines['residual'], 'residual (block means)', below, color=f'@{view.axis_name}',
              width=1.2, hovertemplate='residual ' + hover),
        curve(lines['candidate'], f'{name} would explain', below, color='@candidate', width=2,
              showlegend=preview is not None, hovertemplate=f'{name} {hover}'),
        curve(lines['left'], f'left with {name}', below, color='@model', width=0.9, dash='dot',
              showlegend=preview is not None, hovertemplate='would be left ' + hover),
        cursor_trace(below),
    ]  # fmt: skip


def cursor_trace(place: Mapping[str, str]) -> dict[str, Any]:
    """Return the trace that marks the moment under the cursor, which the browser moves."""
    return {
        'type': 'scatter', 'mode': 'markers', 'name': 'cursor', 'showlegend': False,
        'x': [None], 'y': [None], 'hoverinfo': 'skip', 'cliponaxis': False,
        'marker': {'color': '@panel', 'size': 13, 'line': {'color': '@candidate', 'width': 3}},
        **place,
    }  # fmt: skip


def cursor_rows(
    version: Version | None, view: View, timeline: Timeline, window: tuple[float, float] | None
) -> dict[str, Any]:
    """Return the blocks one cursor knows: hours, die [°C], its rate [°C/min], residual, place."""
    if version is None:
        return {}
    factor = DISPLAY_UNITS[view.sensor].factor
    blocks = version.blocks
    rows = np.flatnonzero(inside_window(blocks, timeline, window))
    rows = rows[:: max(1, len(rows) // MAX_CURSOR_ROWS)]
    columns = {
        'hours': [timeline.start(run.run) + run.time / 3600.0 for run in blocks],
        'temperature': [run.temperature for run in blocks],
        'rate': [run.rate for run in blocks],
        'residual': [run.residual(view.sensor)[:, view.axis] * factor for run in blocks],
    }
    cells = np.concatenate([
        np.array([f'{run.run}|{phase}|{cycle}' for phase, cycle in
                  zip(run.phase.tolist(), run.cycle.tolist(), strict=True)], dtype=object)
        for run in blocks
    ])  # fmt: skip
    table: dict[str, Any] = {
        name: rounded(np.concatenate(parts)[rows], 6) for name, parts in columns.items()
    }
    return table | {'cell': cells[rows].tolist()}


def _time_title(timeline: Timeline) -> str:
    return 'time [h], one run after the other' if len(timeline.runs) > 1 else 'time [h]'


def _marks(timeline: Timeline) -> list[dict[str, Any]]:
    """Return the name of each run at its beginning."""
    return [
        {
            'text': run, 'x': start, 'y': 1, 'xref': 'x', 'yref': 'paper', 'xanchor': 'left',
            'yanchor': 'bottom', 'showarrow': False, 'font': {'size': 11, 'color': '@soft'},
        }
        for run, start in zip(timeline.runs, timeline.starts, strict=True)
    ]  # fmt: skip


def _shapes(version: Version | None, view: View, timeline: Timeline) -> list[dict[str, Any]]:
    """Return the noise band, the chosen place, and a line where a run ends."""
    shapes: list[dict[str, Any]] = [
        {
            'type': 'line', 'xref': 'x', 'yref': 'paper', 'x0': start, 'x1': start, 'y0': 0,
            'y1': 1, 'line': {'color': '@axis', 'width': 1, 'dash': 'dot'}, 'layer': 'below',
        }
        for start in timeline.starts[1:]
    ]  # fmt: skip
    floor = noise_band(version, view)
    if floor:
        shapes.append({
            'type': 'rect', 'xref': 'x3 domain', 'yref': 'y3', 'x0': 0, 'x1': 1, 'y0': -floor,
            'y1': floor, 'layer': 'below', 'line': {'width': 0}, 'fillcolor': '@noise',
        })  # fmt: skip
    if version and view.place:
        for run in version.blocks:
            rows = np.flatnonzero(view.place.rows(run))
            if len(rows):
                start = timeline.start(run.run)
                shapes.append({
                    'type': 'rect', 'xref': 'x', 'yref': 'paper', 'y0': 0, 'y1': 1,
                    'x0': start + run.time[rows[0]] / 3600.0,
                    'x1': start + run.time[rows[-1]] / 3600.0,
                    'layer': 'below', 'line': {'width': 0}, 'fillcolor': '@band',
                })  # fmt: skip
    return shapes


def noise_band(version: Version | None, view: View) -> float | None:
    """Return twice the noise floor of the axis [display unit]."""
    if version is None:
        return None
    floor = version.comparison['sensors'][view.sensor]['noise_floor'][view.axis]
    return None if floor is None else 2.0 * float(floor) * DISPLAY_UNITS[view.sensor].factor


def unbroken(time: FloatArray, values: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return the stretches of block means between which nothing was recorded.

    >>> [part.tolist() for part, _ in unbroken(np.array([0.0, 1.0, 2.0, 9.0]), np.zeros(4))]
    [[0.0, 1.0, 2.0], [9.0]]
    """
    if len(time) < 2:
        return [(time, values)]
    step = np.diff(time)
    cuts = np.flatnonzero(step > GAP_STEPS * np.median(step)) + 1
    return list(zip(np.split(time, cuts), np.split(values, cuts), strict=True))


def _joined(pieces: Sequence[tuple[FloatArray, FloatArray]]) -> dict[str, list[float | None]]:
    """Return the pieces as one line, broken between them."""
    x: list[float | None] = []
    y: list[float | None] = []
    for time, values in pieces:
        if x:
            x.append(x[-1])
            y.append(None)
        x += rounded(time, 7)
        y += rounded(values, 4)
    return {'x': x, 'y': y}


def _middle(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else 0.0


LINE_POINTS = 2400
"""Points of one line over the whole width of the figure."""
MAX_CACHED_LINES = 512
"""Lines over whole bags kept in memory."""


def sample_line(
    bag: StoredBag, sensor: str, axis: int, window: tuple[float, float], points: int = LINE_POINTS
) -> tuple[FloatArray, FloatArray]:
    """Return time since the first sample [s] and values [SI unit] within a window [s]."""
    return _line(bag, sensor, axis, window, points)


def temperature_line(
    bag: StoredBag, window: tuple[float, float], points: int = LINE_POINTS // 4
) -> tuple[FloatArray, FloatArray]:
    """Return time since the first sample [s] and die temperature [°C] within a window [s]."""
    return _line(bag, 'temperature', 0, window, points)


def _line(
    bag: StoredBag, column: str, axis: int, window: tuple[float, float], points: int
) -> tuple[FloatArray, FloatArray]:
    if window[0] <= 0.0 and window[1] >= bag.duration:
        return _overview(bag, column, axis, points)
    stamp = bag.stamp()
    edges = np.array(window) * 1e9 + stamp[0]
    first, last = np.searchsorted(stamp, edges.astype(np.int64))
    return _drawn(bag, column, axis, slice(max(int(first) - 1, 0), int(last) + 1), points)


@lru_cache(maxsize=MAX_CACHED_LINES)
def _overview(
    bag: StoredBag, column: str, axis: int, points: int
) -> tuple[FloatArray, FloatArray]:
    return _drawn(bag, column, axis, slice(0, None), points)


def _drawn(
    bag: StoredBag, column: str, axis: int, rows: slice, points: int
) -> tuple[FloatArray, FloatArray]:
    stamp = bag.stamp()
    if not len(stamp):
        return np.empty(0), np.empty(0)
    part = bag.temperature() if column == 'temperature' else bag.measured(column)[:, axis]
    values = np.ascontiguousarray(part[rows], dtype=np.float64)
    time = (stamp[rows] - stamp[0]) * 1e-9
    period = bag.duration / max(bag.samples - 1, 1)
    return decimated(time, values, max(points, 16), max(60.0, 5.0 * period))
