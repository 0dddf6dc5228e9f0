# SPDX-License-Identifier: Apache-2.0
"""Results in a notebook: they print as text, show as tables and draw themselves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from imu_recording.user_error import UserError

from thermal_comp.presentation import comparison, diagnosis, growth, model

if TYPE_CHECKING:
    from thermal_comp.presentation.picture import Picture


class Presentation(Protocol):
    """A module that shows one kind of result."""

    def text(self, content: Any, /) -> str:
        """Return the result's `to_dict()` as lines for a terminal."""

    def table(self, content: Any, /) -> str:
        """Return the result's `to_dict()` as HTML."""

    def picture(self, result: Any, /) -> Picture:
        """Return a picture of the result."""


PRESENTATIONS: Mapping[str, Presentation] = {
    'comparison': comparison,
    'diagnosis': diagnosis,
    'growth': growth,
    'model': model,
}
"""Kind of result → module that shows it."""


class Presented(ABC):
    """A result with a text, a table and a picture."""

    presentation: ClassVar[str]
    """Kind of result, a key of PRESENTATIONS."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""

    def __repr__(self) -> str:
        """Return the result as lines for a terminal."""
        return PRESENTATIONS[self.presentation].text(self.to_dict())

    def _repr_html_(self) -> str:
        """Return the result as a table for a notebook."""
        return PRESENTATIONS[self.presentation].table(self.to_dict())

    def plot(self) -> Picture:
        """Return a picture of the result; needs matplotlib, which is optional."""
        try:
            return PRESENTATIONS[self.presentation].picture(self)
        except ModuleNotFoundError as error:
            if error.name and error.name.startswith('matplotlib'):
                raise UserError('plot() needs matplotlib: pip install matplotlib') from None
            raise
