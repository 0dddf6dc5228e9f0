# SPDX-License-Identifier: Apache-2.0
"""Evidence an effect needs before it is named, and its calibration by draws of noise alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.candidates import campaign_of, candidates, families
from thermal_comp.diagnosis.null_simulation import Draw, SlowEffects, reached_in_draws
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import usable_sensors
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import fit_noise_to_values
from thermal_comp.noise.of_runs import determined_noise
from thermal_comp.noise.process import draw_noise

EVIDENCE_MARGIN = 5.0
THRESHOLD_QUANTILE = 0.995
TAIL_QUANTILE = 0.9
"""Quantile from which on the tail is taken as exponential."""
Listed = Mapping[Sensor, tuple[Effect, ...]]


def threshold_of(
    effect: Effect | type[Effect], thresholds: Mapping[str, float] | None = None
) -> float:
    """Return the evidence an effect needs before it is named: its own, or of a calibration."""
    return (thresholds or {}).get(effect.name, effect.least_evidence)


def calibrated_thresholds(
    runs: Sequence[PreparedRun],
    base: Listed,
    catalogue: Mapping[str, type[Effect]],
    draws: int,
    seed: int = 0,
) -> dict[str, float]:
    """Return the evidence each effect needs: quantile over draws of noise alone, plus a margin.

    The draws have the noise fitted to the recordings; no threshold falls below the effect's own.
    """
    noise, _ = determined_noise(runs, {s: base[s] for s in usable_sensors(runs)[0]})
    reached = reached_without_effect(runs, noise, base, catalogue, draws, seed)
    return {
        name: max(
            catalogue[name].least_evidence,
            tail_quantile(found, THRESHOLD_QUANTILE) + EVIDENCE_MARGIN,
        )
        for name, found in reached.items()
    }


def reached_without_effect(
    runs: Sequence[PreparedRun],
    noise: Mapping[Sensor, NoiseModel],
    base: Listed,
    catalogue: Mapping[str, type[Effect]],
    draws: int,
    seed: int = 0,
) -> dict[str, FloatArray]:
    """Return the evidence each effect reaches in draws of the noise, for all sensors together.

    0 stands for a draw in which there was nothing to rate.
    """
    source = ColumnSource(runs)
    found: dict[str, list[FloatArray]] = {}
    with ThreadPoolExecutor() as pool:
        for number, (sensor, model) in enumerate(noise.items()):
            rng = np.random.default_rng([seed, number])
            drawn = [_draw(runs, sensor, model, rng) for _ in range(draws)]
            design = CandidateDesign(source, sensor, model, base[sensor])
            # How much an effect of time reaches depends on how well slow noise is known.
            slow = {n: e for n, e in catalogue.items() if e.time_only}
            steady = {n: e for n, e in catalogue.items() if not e.time_only}
            scored = SlowEffects(source, slow, _fixed_columns(design, slow))
            tasks = [pool.submit(_reached_once, scored, design, base[sensor], d) for d in drawn]
            for name, values in reached_in_draws(design, families(design, steady), drawn).items():
                found.setdefault(name, []).append(values)
            once = [task.result() for task in tasks]
            for name in {n for some in once for n in some}:
                values = np.array([some.get(name, 0.0) for some in once])
                found.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in found.items()}


def tail_quantile(values: FloatArray, share: float) -> float:
    """Return the quantile of a sample, at least that of an exponential fitted to its tail.

    Beyond TAIL_QUANTILE, q₀, the excess has mean s: q(p) = q(q₀) + s · ln((1 − q₀) / (1 − p)).
    """
    start = float(np.quantile(values, TAIL_QUANTILE))
    beyond = values[values > start]
    scale = float((beyond - start).mean()) if len(beyond) else 0.0
    extrapolated = start + scale * float(np.log((1.0 - TAIL_QUANTILE) / (1.0 - share)))
    return max(extrapolated, float(np.quantile(values, share)))


def _draw(
    runs: Sequence[PreparedRun], sensor: Sensor, noise: NoiseModel, rng: np.random.Generator
) -> Draw:
    """Return one draw with the gaps of what was measured."""
    drawn = [draw_noise(noise, run.slot, run.period, rng) for run in runs]
    for values, run in zip(drawn, runs, strict=True):
        values[~np.isfinite(run.measured[sensor]).all(axis=1)] = np.nan
    return drawn


def _fixed_columns(
    design: CandidateDesign, catalogue: Mapping[str, type[Effect]]
) -> dict[Effect, list[FloatArray]]:
    tried = candidates(design, catalogue, campaign_of(design))
    effects = {part for some in tried.values() for c in some for part in c.effect.parts()}
    return {e: [run.columns(e, design.sensor) for run in design.source.runs] for e in effects}


def _reached_once(
    scored: SlowEffects, design: CandidateDesign, base: Sequence[Effect], drawn: Draw
) -> dict[str, float]:
    noise = fit_noise_to_values(design.source.runs, drawn)
    return scored.reached(CandidateDesign(design.source, design.sensor, noise, base, drawn))
