# SPDX-License-Identifier: Apache-2.0
"""Read values out of a document so that every refusal names the field."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.model import ModelError


class Field:
    """One value of a document and its dotted name.

    >>> Field({'a': {'b': [1, 'x']}})['a']['b'].array()
    Traceback (most recent call last):
    thermal_comp.model.ModelError: a.b: 'x' is no number
    """

    def __init__(self, value: Any, name: str = '') -> None:
        self.value = value
        self.name = name

    def refuse(self, reason: str) -> ModelError:
        """Return the error that names this field."""
        return ModelError(f'{self.name or "document"}: {reason}')

    def __getitem__(self, key: str) -> Field:
        """Return an entry that has to be there."""
        name = f'{self.name}.{key}' if self.name else key
        if key not in self.mapping():
            raise ModelError(f'{name}: missing')
        return Field(self.value[key], name)

    def get(self, key: str, default: Any) -> Field:
        """Return an entry that may be absent."""
        name = f'{self.name}.{key}' if self.name else key
        return Field(self.mapping().get(key, default), name)

    def mapping(self) -> Mapping[str, Any]:
        """Return the value as a mapping."""
        if not isinstance(self.value, Mapping):
            raise self.refuse(f'is {_shown(self.value)}, expected a mapping')
        return self.value

    def only(self, *names: str) -> None:
        """Refuse an entry of another name: what nobody reads was meant to be read."""
        unknown = [key for key in self.mapping() if key not in names]
        if unknown:
            entry = Field(None, f'{self.name}.{unknown[0]}' if self.name else str(unknown[0]))
            raise entry.refuse(f'no such field; there are {", ".join(names)}')

    def entries(self) -> dict[str, Field]:
        """Return the entries of a mapping by key."""
        return {str(key): self[key] for key in self.mapping()}

    def items(self) -> list[Field]:
        """Return the items of a list."""
        if not isinstance(self.value, list):
            raise self.refuse(f'is {_shown(self.value)}, expected a list')
        return [Field(item, f'{self.name}[{i}]') for i, item in enumerate(self.value)]

    def text(self) -> str:
        """Return the value as text."""
        if not isinstance(self.value, str):
            raise self.refuse(f'is {_shown(self.value)}, expected text')
        return self.value

    def flag(self) -> bool:
        """Return the value as true or false."""
        if not isinstance(self.value, bool):
            raise self.refuse(f'is {_shown(self.value)}, expected true or false')
        return self.value

    def number(self) -> float:
        """Return the value as a finite number; text such as 1e-5, which YAML leaves, counts."""
        value = self.value
        try:
            if isinstance(value, bool | None | list | Mapping):
                raise ValueError
            number = float(value)
        except ValueError:
            raise self.refuse(f'{_shown(value)} is no number') from None
        if not math.isfinite(number):
            raise self.refuse(f'is {number}, expected a finite number')
        return number

    def array(self, *shape: int | None) -> FloatArray:
        """Return nested lists as an array; None in `shape` stands for any length."""
        array = np.array(self._numbers(self.value))
        fits = array.ndim == len(shape) and all(
            w is None or w == n for w, n in zip(shape, array.shape, strict=True)
        )
        if shape and not fits:
            wanted = ' × '.join('any' if n is None else str(n) for n in shape)
            raise self.refuse(f'has shape {array.shape}, expected {wanted}')
        return array

    def _numbers(self, value: Any) -> Any:
        if not isinstance(value, list):
            return Field(value, self.name).number()
        rows = [self._numbers(item) for item in value]
        if len({np.shape(row) for row in rows}) > 1:
            raise self.refuse('has rows of different lengths')
        return rows


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 40 else f'{text[:37]}…'
