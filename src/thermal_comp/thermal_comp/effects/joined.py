# SPDX-License-Identifier: Apache-2.0
"""Effects that occur more than once, as one each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from thermal_comp.effects.effect import Effect


def joined_effects(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects with the values of repeated ones joined: several steps are one effect."""
    joined: dict[str, Effect] = {}
    for effect in effects:
        before = joined.get(effect.name)
        if before is not None:
            values = {
                name: tuple(sorted({*value, *before.shape_parameters[name]}))
                for name, value in effect.shape_parameters.items()
                if isinstance(value, tuple)
            }
            joined[effect.name] = replace(before, **values)
        else:
            joined[effect.name] = effect
    return tuple(joined.values())
