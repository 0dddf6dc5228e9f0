# SPDX-License-Identifier: Apache-2.0
"""What is drawn over each other is told apart, by deuteranopes too; one colour, one meaning."""

from itertools import combinations

import numpy as np
import pytest
from imu_workbench.report.figures.modelled import FAILURE_COLOUR_SCALE, TEXT_COLOURS
from imu_workbench.report.figures.palette import COLOURS
from imu_workbench.web.case.figures.scatter import BRANCH_COLOURS

OVER_EACH_OTHER = [
    *(('raw_soft', curve) for curve in ('model', 'x', 'y', 'z', 'candidate')),
    *(('candidate', curve) for curve in ('model', 'x', 'y', 'z', 'hot', 'cold')),
    *(('temperature', curve) for curve in ('model', 'raw_soft', 'x', 'y', 'z')),
    *combinations('xyz', 2),
    *combinations([f'd{i}' for i in range(6)], 2),
    ('hot', 'cold'),
    ('raw', 'model'),
]
APART = 20.0
"""Least distance of two colours in CIELAB; 2 is just seen side by side."""
DEUTERANOPE = np.array(
    [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]
)
"""Linear RGB as a deuteranope sees it (Viénot, Brettel and Mollon 1999)."""
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
     [0.0193339, 0.1191920, 0.9503041]]
)  # fmt: skip
WHITE = np.array([0.95047, 1.0, 1.08883])


def linear(colour: str) -> np.ndarray:
    """Return (3,) linear sRGB of #rrggbb."""
    levels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    return np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """Return (3,) CIELAB of linear sRGB."""
    ratio = XYZ @ np.clip(rgb, 0.0, 1.0) / WHITE
    f = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def distance(one: str, other: str, seen_by: np.ndarray) -> float:
    return float(np.linalg.norm(lab(seen_by @ linear(one)) - lab(seen_by @ linear(other))))


@pytest.mark.parametrize('theme', COLOURS)
@pytest.mark.parametrize('seen_by', [np.eye(3), DEUTERANOPE], ids=['all cones', 'deuteranope'])
@pytest.mark.parametrize('pair', OVER_EACH_OTHER, ids='-'.join)
def test_colours_over_each_other_are_told_apart(theme, seen_by, pair) -> None:
    one, other = (COLOURS[theme][name] for name in pair)
    assert distance(one, other, seen_by) > APART


def test_a_deuteranope_takes_a_grey_for_a_green_that_others_tell_apart() -> None:
    assert distance('#8b95a3', '#009e73', np.eye(3)) > 45.0
    assert distance('#8b95a3', '#009e73', DEUTERANOPE) < 21.0  # what was measured and modelled in


@pytest.mark.parametrize('theme', COLOURS)
def test_no_two_meanings_of_one_figure_share_a_colour(theme) -> None:
    meanings = ['x', 'y', 'z', 'temperature', 'candidate', 'raw', 'raw_soft', 'model']
    meanings += [
        colour.removeprefix('@') for colour in BRANCH_COLOURS.values() if colour != '@raw'
    ]
    meanings += [f'd{i}' for i in range(6)]
    assert len({COLOURS[theme][name] for name in meanings}) == len(meanings)


@pytest.mark.parametrize('theme', COLOURS)
@pytest.mark.parametrize('axis', 'xyz')
def test_no_device_is_taken_for_an_axis(theme, axis) -> None:
    axes = COLOURS[theme][axis]
    assert all(distance(COLOURS[theme][f'd{i}'], axes, np.eye(3)) > APART for i in range(6))


def contrast(one: np.ndarray, other: np.ndarray) -> float:
    """Contrast of two colours in linear sRGB (WCAG 2)."""
    low, high = sorted(float(XYZ[1] @ rgb) + 0.05 for rgb in (one, other))
    return high / low


@pytest.mark.parametrize('theme', COLOURS)
def test_numbers_in_a_map_contrast_with_their_cells(theme) -> None:
    stops = [
        (place, COLOURS[theme][name[1:]]) for place, name in FAILURE_COLOUR_SCALE['colorscale']
    ]
    levels = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for _, c in stops])
    for value in np.linspace(0.0, 1.0, 101):
        at = [np.interp(value, [place for place, _ in stops], levels[:, k]) for k in range(3)]
        cell = '#' + ''.join(f'{round(level):02x}' for level in at)
        colour = next(name for most, name in TEXT_COLOURS if value < most)
        assert contrast(linear(cell), linear(COLOURS[theme][colour[1:]])) > 3.0, (value, cell)
