# SPDX-License-Identifier: Apache-2.0
"""The effects a tab knows, in words: the catalogue and the user's own files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.explanation import explanation
from thermal_comp.effects.user_effects import effect_catalogue


@dataclass
class Catalogue:
    """What `explain` says of every effect, by name."""

    effects: dict[str, dict[str, Any]] = field(
        default_factory=lambda: {name: told(effect) for name, effect in EFFECTS.items()}
    )


def told(effect: type[Effect]) -> dict[str, Any]:
    """Return an effect in words."""
    return explanation(effect) | {'coupled': effect.coupled}


def effects_task(
    progress: Callable[[str], None], files: Sequence[Path]
) -> dict[str, dict[str, Any]]:
    """Return the catalogue with the effects of the files, each checked against the contract."""
    progress('checking the effect file')
    return {name: told(effect) for name, effect in effect_catalogue(files).items()}
