# SPDX-License-Identifier: Apache-2.0
"""The answer of a verb, the progress line while it works, and the line of an error."""

from __future__ import annotations

import json
import math
import shutil
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

FLAT_ITEM_TYPES = frozenset({float, int, bool, type(None)})
"""Types of the items of a list that stands on one line."""


CHECK_FAILED = 3
"""Exit code of a check that was made and did not hold."""


@dataclass(frozen=True)
class Answer:
    """The result of a verb; page, JSON and terminal all present the same `content`."""

    content: dict[str, Any]
    """Plain values (dict, list, str, numbers, numpy arrays); non-finite numbers become null."""
    text: str
    """What the terminal shows."""
    exit_code: int = 0
    """0: answered; CHECK_FAILED: answered, and what was to be checked does not hold."""


def plain(value: Any) -> Any:
    """Return the value as JSON knows it: arrays as lists, NaN and infinity as None.

    >>> plain({'rms': np.array([1.0, np.nan]), 'n': np.int64(3), 'path': Path('a')})
    {'rms': [1.0, None], 'n': 3, 'path': 'a'}
    """
    kind = type(value)
    if kind in FLAT_ITEM_TYPES or kind is str:
        return None if kind is float and not math.isfinite(value) else value
    if kind is list and FLAT_ITEM_TYPES.issuperset(map(type, value)):
        return _finite(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, str):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f'a value of type {type(value).__name__} has no place in a JSON answer')


def _finite(values: list[Any]) -> list[Any]:
    """Return numbers with NaN and infinity as None; the list itself where there is neither."""
    if None not in values and math.isfinite(sum(values)):
        return values
    return [None if type(x) is float and not math.isfinite(x) else x for x in values]


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write the content as UTF-8 JSON, in the order it was made, a list of numbers on one line."""
    path.write_text(_json_text(plain(content), 0) + '\n', 'utf-8')


def _json_text(value: Any, depth: int) -> str:
    """Return plain values as JSON, one space deeper at every level.

    >>> print(_json_text({'rms': [1.0, None], 'where': [{'phase': 'ramp'}], 'none': {}}, 0))
    {
     "rms": [1.0, null],
     "where": [
      {
       "phase": "ramp"
      }
     ],
     "none": {}
    }
    """
    if not value or not isinstance(value, dict | list) or _is_flat(value):
        return json.dumps(value, ensure_ascii=False)
    inner = '\n' + ' ' * (depth + 1)
    if isinstance(value, dict):
        names = (json.dumps(key, ensure_ascii=False) for key in value)
        items = [
            f'{k}: {_json_text(v, depth + 1)}' for k, v in zip(names, value.values(), strict=True)
        ]
        opened, closed = '{}'
    else:
        items = [_json_text(item, depth + 1) for item in value]
        opened, closed = '[]'
    return f'{opened}{inner}{("," + inner).join(items)}\n{" " * depth}{closed}'


def _is_flat(value: Any) -> bool:
    return isinstance(value, list) and FLAT_ITEM_TYPES.issuperset(map(type, value))


def error_line(error: Exception) -> str:
    r"""Return what went wrong, with the file's name where the system knows it.

    >>> error_line(ValueError('two\n  words'))
    'two words'
    """
    if isinstance(error, OSError) and error.strerror:
        text = f'{error.filename}: {error.strerror}' if error.filename else error.strerror
    else:
        text = str(error) or type(error).__name__
    return ' '.join(text.split())


def show_progress(text: str) -> None:
    """Replace the progress line on standard error by `text`; '' clears it."""
    if not sys.stderr.isatty():
        return
    width = shutil.get_terminal_size().columns - 1
    sys.stderr.write(f'\r\x1b[K{text[:width]}')
    sys.stderr.flush()
