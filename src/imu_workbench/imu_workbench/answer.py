# SPDX-License-Identifier: Apache-2.0
"""What a command answers: plain content for --json, text for the terminal, an exit code."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

NUMBERS = re.compile(r'\[\s+(?:(?:-?\d[\d.eE+-]*|null|true|false),\s+)*[-\d.eE+a-z]+\s+\]')
"""A list of numbers as `json.dumps` indents it."""


@dataclass(frozen=True)
class Answer:
    """The result of a verb; page, JSON and terminal all present the same `content`."""

    content: dict[str, Any]
    """Plain values (dict, list, str, numbers, numpy arrays); non-finite numbers become null."""
    text: str
    """What the terminal shows."""
    exit_code: int = 0
    """0: answered; 1: answered, and the answer is a failure the caller should see."""


def plain(value: Any) -> Any:
    """Return the value as JSON knows it: arrays as lists, NaN and infinity as None.

    >>> plain({'rms': np.array([1.0, np.nan]), 'n': np.int64(3), 'path': Path('a')})
    {'rms': [1.0, None], 'n': 3, 'path': 'a'}
    """
    if isinstance(value, str | bool | int | None) and not isinstance(value, np.generic):
        return value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f'a value of type {type(value).__name__} has no place in a JSON answer')


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write the content as UTF-8 JSON, in the order it was made, a list of numbers on one line."""
    text = json.dumps(plain(content), indent=1, ensure_ascii=False)
    path.write_text(NUMBERS.sub(lambda found: ' '.join(found[0].split()), text) + '\n', 'utf-8')
