# SPDX-License-Identifier: Apache-2.0
"""The page as it looks, in three widths and both themes, against stored pictures.

Pictures are kept in cells of CELL px. What stands on the background is compared as ink in blocks
of BLOCK cells (84 px): a block differs where one picture has no more than LESS of the other's ink,
and at most SHARE of the blocks with ink may. The letters of another font move ink within a block
(Liberation for DejaVu: 4 % of the blocks at 1280 px, 8 % at 390); half a page without its cards is
55 % and more. `pytest --update-golden` takes the pictures anew: look before you commit.
"""

from __future__ import annotations

import io
import itertools
from pathlib import Path

import numpy as np
import pytest
from imu_workbench.report.figures.palette import COLOURS
from PIL import Image, ImageChops

GOLDEN = Path(__file__).resolve().parents[1] / 'golden' / 'pages'
CELL, BLOCK = 12, 7
LESS, SHARE = 0.35, 0.12
FAINT, LEAST_INK = 12.0, 3.0
"""Levels of 255 above the background from which a cell has ink, a block enough to be compared."""
SAME_BACKGROUND = 16.0
"""Levels of 255 by which the background may differ."""
HEIGHT = 1000
DRAWN = """colour => {
  const seen = [...document.querySelectorAll('.js-plotly-plot')].filter(plot => {
    const { top, bottom } = plot.getBoundingClientRect();
    return top < innerHeight && bottom > 0;
  });
  return seen.every(plot => plot.querySelector('.main-svg')
      && plot._fullLayout.font.color === colour
      && Math.abs(plot._fullLayout.width - plot.clientWidth) < 2)
    && document.querySelector('.place:not(.all)');
}"""
"""All figures that are seen are drawn, in the colours and the width the page has by now."""


def reduced(png: bytes) -> Image.Image:
    """The picture in cells."""
    whole = Image.open(io.BytesIO(png)).convert('RGB')
    size = (whole.width // CELL, whole.height // CELL)
    return whole.resize(size, Image.Resampling.BOX)


def background(picture: Image.Image) -> np.ndarray:
    """(3,) the colour most of the picture has [levels of 255]."""
    return np.median(np.asarray(picture, dtype=float).reshape(-1, 3), axis=0)


def ink(picture: Image.Image) -> np.ndarray:
    """Mean distance of every block from the background, the largest channel's [levels of 255]."""
    apart = np.abs(np.asarray(picture, dtype=float) - background(picture)).max(axis=2)
    apart[apart < FAINT] = 0.0
    rows, columns = (size // BLOCK for size in apart.shape)
    blocks = apart[: rows * BLOCK, : columns * BLOCK].reshape(rows, BLOCK, columns, BLOCK)
    return blocks.mean(axis=(1, 3))


def differing(one: Image.Image, other: Image.Image) -> float:
    """Share of the blocks with ink that differ; all of them where size or background do."""
    if one.size != other.size:
        return 1.0
    if np.abs(background(one) - background(other)).max() > SAME_BACKGROUND:
        return 1.0
    both = np.stack([ink(one), ink(other)])
    least, most = both.min(axis=0), both.max(axis=0)
    compared = most > LEAST_INK
    return float((least < LESS * most)[compared].mean())


def stored(width: int, theme: str) -> Path:
    return GOLDEN / f'case_{width}_{theme}.png'


@pytest.mark.parametrize(
    ('widths', 'themes'), [((1440, 1280), ('light', 'dark')), ((390,), ('dark', 'light'))]
)
def test_the_page_looks_as_it_did(hidden_effect_server, watch, request, widths, themes, tmp_path):
    address = hidden_effect_server.address
    watched = watch(address, widths[0], HEIGHT, color_scheme=themes[0])
    page = watched.page
    page.locator('.verdict.missing').wait_for()
    page.locator('.rail[aria-busy=false]').wait_for()
    page.locator('.job').first.wait_for(state='detached')
    found = {}
    for width, theme in itertools.product(widths, themes):
        page.set_viewport_size({'width': width, 'height': HEIGHT})
        page.emulate_media(color_scheme=theme, reduced_motion='reduce')
        page.locator(f'body.body--{theme}').wait_for()
        page.wait_for_function(DRAWN, arg=COLOURS[theme]['text'])
        page.mouse.move(0, 0)
        picture = reduced(page.screenshot(animations='disabled'))
        path = stored(width, theme)
        if request.config.getoption('--update-golden'):
            path.parent.mkdir(exist_ok=True)
            picture.save(path)
            continue
        picture.save(tmp_path / path.name)
        found[path.name] = differing(picture, Image.open(path).convert('RGB'))
    other = {name: f'{share:.1%}' for name, share in found.items() if share > SHARE}
    assert not other, f'shares of the pictures that differ: {other}; see {tmp_path}'
    watched.check()


@pytest.mark.parametrize('theme', ['light', 'dark'])
@pytest.mark.parametrize('width', [1440, 1280, 390])
def test_the_comparison_sees_cards_that_are_gone_and_not_that_they_moved(width, theme):
    known = Image.open(stored(width, theme)).convert('RGB')
    other = Image.open(stored(width, {'light': 'dark', 'dark': 'light'}[theme])).convert('RGB')
    assert differing(known, other) == 1.0
    assert differing(ImageChops.offset(known, 0, 1), known) < SHARE
    without = known.copy()
    colour = tuple(int(level) for level in background(known))
    without.paste(colour, (0, known.height // 4, known.width, 3 * known.height // 4))
    assert differing(without, known) > 3.0 * SHARE
    without = known.copy()
    without.paste(colour, (2 * known.width // 3, known.height // 3, known.width, known.height))
    assert differing(without, known) > SHARE
