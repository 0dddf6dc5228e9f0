# SPDX-License-Identifier: Apache-2.0
"""A board in its attitude, drawn in perspective: seen from the south and above, east right.

Plain SVG: it needs no graphics card, costs a kilobyte a frame and looks the same everywhere.
"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray
from orientation_filters.rotation.arrays import to_matrix

from imu_workbench.report.figures.palette import AXES, painted
from imu_workbench.web.live.readings import LiveAttitude

VIEWPOINT = np.array([1.6, -6.0, 3.4])
"""Where the viewer is, in the world's axes (east, north, up); the board is at the origin."""
HALF_SIZE = np.array([1.0, 0.65, 0.1])
"""Half of the board's length, width and thickness."""
AXIS_LENGTH = 1.55
"""Length of the sensor's axes as drawn."""
COMPASS_HEIGHT, COMPASS_RADIUS = -0.9, 1.25
"""Height and radius of the compass rose."""
WIDTH_PX, HEIGHT_PX = 300.0, 246.0
"""Width and height of the drawing [px]."""


def board_svg(name: str, attitude: LiveAttitude | None, colour: str, theme: str) -> str:
    """Return the drawing; `colour` is a token of the palette, `theme` 'light' or 'dark'."""
    paint = {
        key: str(painted(f'@{key}', theme)) for key in ('text', 'soft', 'grid', 'axis', *AXES)
    }
    parts = _ground(paint)
    label = f'{name}: no attitude'
    if attitude is not None:
        degrees = np.degrees(attitude.euler)
        label = f'{name}: roll {degrees[0]:.1f}°, pitch {degrees[1]:.1f}°, yaw {degrees[2]:.1f}°'
        parts += _board(to_matrix(attitude.orientation), str(painted(colour, theme)), paint)
    parts.append(_text(np.array([8.0, 18.0]), name, paint['text'], 'start'))
    return (
        f'<svg viewBox="0 0 {WIDTH_PX:.0f} {HEIGHT_PX:.0f}" role="img" aria-label="{label}">'
        + ''.join(parts)
        + '</svg>'
    )


def projected(points: FloatArray) -> FloatArray:
    """Return where world points (n, 3) are in the drawing (n, 2) [px], y down."""
    forward = -VIEWPOINT / np.linalg.norm(VIEWPOINT)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    seen = np.asarray(points) - VIEWPOINT
    depth = seen @ forward
    scale = 1.5 * WIDTH_PX / depth
    return np.column_stack(
        [WIDTH_PX / 2 + scale * (seen @ right), 0.5 * HEIGHT_PX - scale * (seen @ up)]
    )


def _board(matrix: FloatArray, colour: str, paint: dict[str, str]) -> list[str]:
    """Draw the axes behind the board, the board, the axes before it."""
    arms = [(matrix[:, i] @ VIEWPOINT, i) for i in range(3)]
    behind = [_arm(matrix, i, paint) for toward, i in arms if toward < 0.0]
    before = [_arm(matrix, i, paint) for toward, i in arms if toward >= 0.0]
    return behind + _faces(matrix, colour) + before


def _faces(matrix: FloatArray, colour: str) -> list[str]:
    """Draw the faces that are seen; the top, where the sensor sits, has a mark."""
    drawn = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = matrix[:, axis] * sign
            if normal @ (VIEWPOINT - normal * HALF_SIZE[axis]) <= 0.0:
                continue
            corners = np.zeros((4, 3))
            corners[:, axis] = sign * HALF_SIZE[axis]
            others = [i for i in range(3) if i != axis]
            for i, signs in zip(others, ((-1, 1, 1, -1), (-1, -1, 1, 1)), strict=True):
                corners[:, i] = np.array(signs) * HALF_SIZE[i]
            light = 0.55 + 0.45 * max(normal[2], 0.0)
            drawn.append(_polygon(corners @ matrix.T, colour, light))
            if axis == 2 and sign > 0:
                mark = np.array([[0.55, 0.2, 0.1], [0.85, 0.2, 0.1], [0.85, 0.5, 0.1]])
                mark = np.vstack([mark, [0.55, 0.5, 0.1]])
                drawn.append(_polygon(mark @ matrix.T, '#1b2430', 0.8))
    return drawn


def _arm(matrix: FloatArray, axis: int, paint: dict[str, str]) -> str:
    tip = matrix[:, axis] * AXIS_LENGTH
    ends = projected(np.array([[0.0, 0.0, 0.0], tip, tip * 1.14]))
    line = _line(ends[0], ends[1], paint[AXES[axis]], 2.6)
    return line + _text(ends[2], AXES[axis], paint[AXES[axis]])


def _ground(paint: dict[str, str]) -> list[str]:
    """Draw a compass rose below the board."""
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = np.column_stack(
        [
            COMPASS_RADIUS * np.cos(angle),
            COMPASS_RADIUS * np.sin(angle),
            0 * angle + COMPASS_HEIGHT,
        ]
    )
    points = ' '.join(f'{x:.1f},{y:.1f}' for x, y in projected(ring))
    drawn = [
        f'<polyline points="{points}" fill="none" stroke="{paint["grid"]}" stroke-width="2"/>'
    ]
    for name, east, north in (('E', 1, 0), ('N', 0, 1), ('W', -1, 0), ('S', 0, -1)):
        way = COMPASS_RADIUS * np.array([[0.0, 0.0], [east, north], [1.18 * east, 1.18 * north]])
        ends = projected(np.column_stack([way, [COMPASS_HEIGHT] * 3]))
        drawn.append(_line(ends[0], ends[1], paint['grid'], 1.2))
        drawn.append(_text(ends[2], name, paint['soft']))
    return drawn


def _polygon(points: FloatArray, colour: str, light: float) -> str:
    where = ' '.join(f'{x:.1f},{y:.1f}' for x, y in projected(points))
    dark = 1.0 - light
    return (
        f'<polygon points="{where}" fill="{colour}" stroke="{colour}"/>'
        f'<polygon points="{where}" fill="#000" fill-opacity="{dark:.2f}"/>'
    )


def _line(start: FloatArray, end: FloatArray, colour: str, width: float) -> str:
    return (
        f'<line x1="{start[0]:.1f}" y1="{start[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}" '
        f'stroke="{colour}" stroke-width="{width}" stroke-linecap="round"/>'
    )


def _text(place: FloatArray, text: str, colour: str, anchor: str = 'middle') -> str:
    return (
        f'<text x="{place[0]:.1f}" y="{place[1] + 4.0:.1f}" fill="{colour}" font-size="13" '
        f'text-anchor="{anchor}">{text}</text>'
    )
