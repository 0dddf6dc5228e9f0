# SPDX-License-Identifier: Apache-2.0
"""Evidence an effect needs before it is named, from simulated campaigns without any effect."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.resources import files

import yaml

EVERYWHERE = 15.0
"""Least threshold of any effect: 2 ln of the Bayes factor."""


@cache
def shipped_thresholds() -> Mapping[str, float]:
    """Return the evidence each effect needs, from thresholds.yaml beside this file."""
    text = files('thermal_comp').joinpath('thresholds.yaml').read_text('utf-8')
    return {str(name): float(value) for name, value in yaml.safe_load(text)['thresholds'].items()}


def threshold_of(name: str, thresholds: Mapping[str, float] | None = None) -> float:
    """Return the evidence an effect needs before it is named."""
    table = shipped_thresholds() if thresholds is None else thresholds
    return table.get(name, EVERYWHERE)
