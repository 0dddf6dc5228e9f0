# SPDX-License-Identifier: Apache-2.0
"""Thresholds for one's own campaign: what effects reach where there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from thermal_comp.conditions import Sensor
from thermal_comp.diagnose_bank import ColumnBank, ColumnSource
from thermal_comp.diagnose_candidates import families
from thermal_comp.diagnose_search import WITHOUT_CYCLE_VETO, Search
from thermal_comp.diagnose_thresholds import EVERYWHERE, threshold_of
from thermal_comp.effects.effect import Effect
from thermal_comp.fit import usable_sensors
from thermal_comp.noise import fit_noise
from thermal_comp.noise_process import draw_noise
from thermal_comp.prepared_run import PreparedRun

SLOW = (*WITHOUT_CYCLE_VETO, 'bias_drift')
"""Effects whose evidence depends on how well slow noise is known: it is fitted to every draw."""
MARGIN = 5.0
QUANTILE = 0.995


def calibrated_thresholds(
    runs: Sequence[PreparedRun],
    base: Mapping[Sensor, tuple[Effect, ...]],
    catalogue: Mapping[str, type[Effect]],
    draws: int,
    seed: int = 0,
) -> dict[str, float]:
    """Return the evidence each effect needs: quantile over draws of noise alone, plus a margin.

    The draws have the noise fitted to the recordings; thresholds never fall below the shipped.
    """
    rng = np.random.default_rng(seed)
    reached: dict[str, list[float]] = {}
    source = ColumnSource(runs)
    slow = {name: effect for name, effect in catalogue.items() if name in SLOW}
    sensors, _ = usable_sensors(runs)
    for sensor in sensors:
        noise = fit_noise(runs, sensor)
        steady = ColumnBank(source, sensor, noise, base[sensor])
        others = families(steady, {n: e for n, e in catalogue.items() if n not in SLOW})
        for _ in range(draws):
            drawn = [draw_noise(noise, run.slot, run.period, rng) for run in runs]
            fake = [
                replace(run, measured={**run.measured, sensor: values})
                for run, values in zip(runs, drawn, strict=True)
            ]
            steady.retarget(drawn)
            _collect(reached, Search(steady, others))
            bank = ColumnBank(source, sensor, fit_noise(fake, sensor), base[sensor], drawn)
            _collect(reached, Search(bank, families(bank, slow)))
    return {
        name: max(threshold_of(name), EVERYWHERE, float(np.quantile(found, QUANTILE)) + MARGIN)
        for name, found in reached.items()
    }


def _collect(reached: dict[str, list[float]], search: Search) -> None:
    for rated in search.ranking([]):
        reached.setdefault(rated.name, []).append(rated.evidence)
