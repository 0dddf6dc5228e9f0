# SPDX-License-Identifier: Apache-2.0
"""Results in a notebook: they print as text, show as tables and draw themselves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

from imu_recording.user_error import UserError

if TYPE_CHECKING:
    from thermal_comp.presentation.picture import Picture


class Presented(ABC):
    """A result whose module of this package turns it into `text`, `table` and `picture`."""

    presentation: ClassVar[str]
    """Module of `thermal_comp.presentation`; imported where something is shown."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""

    def __repr__(self) -> str:
        """Return the result as lines for a terminal."""
        return str(self._presentation().text(self.to_dict()))

    def _repr_html_(self) -> str:
        """Return the result as a table for a notebook."""
        return str(self._presentation().table(self.to_dict()))

    def plot(self) -> Picture:
        """Return a picture of the result; needs matplotlib, which is optional."""
        try:
            picture: Picture = self._presentation().picture(self)
        except ModuleNotFoundError as error:
            if error.name and error.name.startswith('matplotlib'):
                raise UserError('plot() needs matplotlib: pip install matplotlib') from None
            raise
        return picture

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
