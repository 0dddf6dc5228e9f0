# SPDX-License-Identifier: Apache-2.0
"""A fixture that tilts turns gravity and field alike: what the magnetometer says about it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnose_bank import ColumnBank
from thermal_comp.diagnose_decision import Outcome
from thermal_comp.effects.effect import Effect

TILT = 'fixture_tilt'
REFUTED = 20.0
"""χ² against a tilt from which no flaw in its form excuses it …"""
REFUTED_SHARE = 2e-4
"""… or this share of what it explains: the larger the tilt, the more a flaw in its form costs."""


def may_tilt(outcome: Outcome) -> bool:
    """Tell whether a tilt is named, or explains what is named as well."""
    return any(TILT in (n.rated.name, *n.ambiguous_with) for n in outcome.named)


def tilts(outcome: Outcome) -> tuple[Effect, ...]:
    """Return the tilt that is named, if one is."""
    return tuple(n.rated.form.effect for n in outcome.named if n.rated.name == TILT)


def tilt_support(tilt: Effect, banks: Sequence[ColumnBank], outcomes: Sequence[Outcome]) -> float:
    """Return the χ² that the second sensor adds to the tilt of the first; −∞: it refutes it.

    One rotation, fitted to both sensors beside what else was named, explains less than the first
    alone would like where the second does not turn: a scale factor that is equal on all axes is
    a tilt to the accelerometer in three orientations, but not to the magnetometer.
    """
    equations = []
    for bank, outcome in zip(banks, outcomes, strict=True):
        known = [
            term
            for named in outcome.named
            if TILT not in (named.rated.name, *named.ambiguous_with)
            for term in named.rated.form.terms
        ]
        equations.append(bank.shared_equations(known, bank.term(tilt)))
    (normal, right), (further, moved) = equations
    alone = _explained(normal, right)
    support = _explained(normal + further, right + moved) - alone
    return support if support > -max(REFUTED, REFUTED_SHARE * alone) else -np.inf


def _explained(normal: FloatArray, right: FloatArray) -> float:
    return float(right @ np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right)
