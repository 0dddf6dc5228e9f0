# SPDX-License-Identifier: Apache-2.0
"""Results in a notebook: they print as text, show as tables and draw themselves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

from imu_recording.user_error import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Presented:
    """A result whose module of this package turns it into `text`, `table` and `picture`."""

    presentation: ClassVar[str]
    """Module of `thermal_comp.presentation`; imported where something is shown."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return the result as lines for a terminal."""
        return str(self._presentation().text(self.to_dict()))

    def _repr_html_(self) -> str:
        """Return the result as a table for a notebook."""
        return str(self._presentation().table(self.to_dict()))

    def plot(self) -> Figure:
        """Return a picture of the result; needs matplotlib, which is optional."""
        figure: Figure = self._presentation().picture(self)
        return figure

    def _presentation(self) -> Any:
        return import_module(f'thermal_comp.presentation.{self.presentation}')


def html_table(
    title: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    notes: Iterable[str] = (),
) -> str:
    """Return a table as HTML; every string is escaped."""
    return ''.join(
        [
            f'<b>{escape(title)}</b><table><thead><tr>',
            *(f'<th>{escape(name)}</th>' for name in head),
            '</tr></thead><tbody>',
            *(
                '<tr>' + ''.join(f'<td>{escape(cell)}</td>' for cell in row) + '</tr>'
                for row in rows
            ),
            '</tbody></table>',
            *(f'<div>{escape(note)}</div>' for note in notes),
        ]
    )


def new_figure(columns: int, height: float = 3.2) -> tuple[Figure, list[Any]]:
    """Return a figure of `columns` panels side by side; it belongs to no window."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise UserError('plot() needs matplotlib: pip install matplotlib') from None
    figure = Figure(figsize=(max(4.0 * columns, 5.0), height), layout='constrained')
    panels = figure.subplots(1, columns, squeeze=False)[0]
    for panel in panels:
        panel.grid(visible=True, alpha=0.3)
        panel.spines[['top', 'right']].set_visible(False)
    return figure, list(panels)
