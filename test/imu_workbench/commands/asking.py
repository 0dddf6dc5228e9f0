# SPDX-License-Identifier: Apache-2.0
"""The verbs through the front end: what they answer, and the one line that refuses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

OWN = '''
from dataclasses import dataclass
import numpy as np
from thermal_comp.effects.effect import Effect, shape_parameter

@dataclass(frozen=True)
class DailyRhythm(Effect):
    """The room's rhythm."""
    period: float = shape_parameter(3000.0, unit='s', bounds=(600.0, 9000.0))
    name = 'daily_rhythm'
    equation = 'error = a · sin(2πt/P)'
    coefficient_units = ('{unit}',)
    mechanism = 'Air conditioning.'
    separation = 'Leave the profile out.'
    typical_size = 'small'
    reference = 'none'

    def columns(self, conditions, state=None):
        return np.sin(2 * np.pi * conditions.time / self.period)[:, None], None
'''
Answer = Callable[..., tuple[int, dict[str, Any], str]]


def refuses(answer: Answer, *arguments: object) -> str:
    """Return the one line that says what is wrong."""
    code, content, line = answer(*arguments)
    assert code == 2
    assert not content
    assert line.count('\n') == 1
    return line
