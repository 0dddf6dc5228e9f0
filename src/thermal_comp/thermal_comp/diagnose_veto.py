# SPDX-License-Identifier: Apache-2.0
"""Effects on runs without thermal cycles have to foresee what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from thermal_comp.compare import compare_prepared
from thermal_comp.diagnose_decision import Outcome, Rejected, decide
from thermal_comp.diagnose_judges import Judge
from thermal_comp.diagnose_search import Search
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.joined import joined_effects
from thermal_comp.fit import fit_prepared
from thermal_comp.model import ModelError

MOST_REJECTED = 8
"""Effects refused before the sensor is left without a name."""


def decide_confirmed(
    search: Search, judges: Sequence[Judge], missing: Sequence[str], base: Sequence[Effect]
) -> Outcome:
    """Return what is said about the sensor; no effect whose held-out error is above the base's.

    Where cycles repeat, leaving one out confirms an effect while it is searched. Without them any
    curve follows a single sweep, and only blocks left out tell which one foresees the rest.
    """
    outcome = decide(search, judges, missing)
    if all(run.has_cycles for run in search.bank.source.runs) or outcome.kind != 'named':
        return outcome
    before = _held_out(search, base)
    rejected: list[Rejected] = []
    while outcome.kind == 'named' and len(rejected) < MOST_REJECTED:
        named = [n.rated.form.effect for n in outcome.named]
        after = _held_out(search, [*base, *named])
        if after <= before:
            break
        worst = outcome.named[0].rated
        rejected.append(Rejected(worst.name, worst.evidence, after, before))
        families = [f for f in search.families if f.name not in {r.name for r in rejected}]
        search = replace(search, families=families)
        outcome = decide(search, judges, missing)
    return replace(outcome, rejected=tuple(rejected))


def _held_out(search: Search, effects: Sequence[Effect]) -> float:
    """Return the rms over the axes of the error on blocks the fit has not seen [unit]."""
    bank = search.bank
    noise = {bank.sensor: bank.noise}
    try:
        model = fit_prepared({bank.sensor: joined_effects(effects)}, bank.source.runs, noise=noise)
    except ModelError:
        return float('inf')
    compared = compare_prepared(model, bank.source.runs, noise=noise).sensors[bank.sensor]
    return float(np.sqrt(np.mean(np.square(compared.held_out_rms))))
