# SPDX-License-Identifier: Apache-2.0
"""A figure that a notebook shows and that belongs to no window; needs matplotlib."""

from __future__ import annotations

from io import BytesIO
from typing import Any

from matplotlib.figure import Figure


class Picture(Figure):
    """A row of panels; `savefig` writes it to a file."""

    def _repr_png_(self) -> bytes:
        """Return the picture as a notebook shows it, whatever its plotting backend."""
        image = BytesIO()
        self.savefig(image, format='png', dpi=90)
        return image.getvalue()


def new_picture(
    columns: int, height: float = 3.2, *, stacked: bool = False
) -> tuple[Picture, list[Any]]:
    """Return a picture of so many panels side by side, or below each other, and the panels."""
    if stacked:
        picture = Picture(figsize=(10.0, height * columns), layout='constrained')
        panels = list(picture.subplots(columns, 1, squeeze=False, sharex=True)[:, 0])
    else:
        picture = Picture(figsize=(max(4.0 * columns, 5.0), height), layout='constrained')
        panels = list(picture.subplots(1, columns, squeeze=False)[0])
    for panel in panels:
        panel.grid(visible=True, alpha=0.3)
        panel.spines[['top', 'right']].set_visible(False)
    return picture, panels
