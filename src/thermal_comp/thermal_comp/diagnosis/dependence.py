# SPDX-License-Identifier: Apache-2.0
"""Remaining dependence of a residual on a variable, or on a channel that was not logged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.generic_regressors import GenericRegressor
from thermal_comp.diagnosis.search import ScoredForm, Search
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup

HALF_WAVES = 48
"""Half waves over a run that are looked at."""
HALF_WAVE_COUNTS = (4, 8, 16, 32, 48)
"""Numbers of the slowest of them that are taken together."""
ABSORBED_POWER_SHARE = 1e-9
"""A half wave of which less than this share of its power is left beside the base says nothing."""
BEND_COUNT = 15
"""Temperatures tried at first, evenly over the range."""
BEND_REFINEMENTS = 2
"""How often the neighbourhood of the best one is searched more finely."""
REGRESSOR_EVIDENCE = 20.0
"""Evidence from which the dependence on a generic regressor counts."""
COMMON_MODE_EVIDENCE = 20.0
"""Evidence from which a common course of the axes counts."""
RUNS_IN_STEP_EVIDENCE = 8.0
"""Evidence from which the runs share the course, so that time is its variable."""
ADEQUATE = 0.9
"""Share of what can be explained from which the regressor of one variable is the law."""
WHOLE_SHARE = 0.95
"""The same where a channel is missing that could act: what hides it is never quite its course."""
VAGUE_SHARE = 0.6
"""Share below which no variable that was logged is behind the residual."""
SIMPLER_SHARE = 0.9
"""A regressor of fewer columns is preferred from this share of the best one's Δχ²."""
PLAIN_SHARE = 0.8
"""Share of its Δχ² a channel has to bring by itself, without products and lags, to be meant."""
CHANNELS_OF: dict[Sensor, tuple[str, ...]] = {
    'accelerometer': ('supply_voltage', 'vibration', 'humidity'),
    'gyroscope': ('supply_voltage', 'vibration', 'humidity'),
    'magnetometer': ('heater', 'compressor', 'supply_voltage'),
}
"""Channels that can act on each sensor."""
LOGGED = ('heater', 'compressor', 'supply_voltage')
"""Channels whose absence alone makes several effects at once suspicious."""
CHAMBER_FREE = ('temperature', 'branch', 'time', 'orientation', 'supply', 'cycle')
"""Variables that no channel of the chamber stands for."""
SWITCHED = ('heater', 'compressor')
"""Channels that drag others along: a supply droops, a plate shakes."""


@dataclass(frozen=True)
class RemainingDependence:
    """The generic regressor that explains most of what effects leave."""

    regressor: GenericRegressor
    evidence: float
    delta_chi2: float
    """Δχ² beyond what noise gives as many columns."""


@dataclass(frozen=True)
class Dependence:
    """What is said of a residual without a name."""

    kind: Literal['unexplained', 'unlogged']
    depends_on: str
    evidence: float


@dataclass(frozen=True)
class Hinge:
    """The bend that explains most."""

    temperature: float
    """[°C]"""
    evidence: float
    delta_chi2: float


@dataclass(frozen=True)
class Coherence:
    """What speaks for a common course; 2 ln of the Bayes factor, about −5 for noise alone."""

    axes: float
    """The axes share it."""
    runs: float
    """The runs share it too, at the same time since their beginning."""

    @property
    def evidence(self) -> float:
        """Both together."""
        return self.axes + max(self.runs, 0.0)


def strongest_regressor(
    search: Search, regressors: Sequence[GenericRegressor], found: Sequence[ScoredForm]
) -> RemainingDependence | None:
    """Return the regressor that explains most of what the effects leave, if it counts."""
    terms = [term for r in found for term in r.form.terms]
    before = search.design.solve(terms)
    best: RemainingDependence | None = None
    for regressor in regressors:
        delta_chi2, rank = search.design.solve([*terms, regressor.term])
        delta_chi2, rank = delta_chi2 - before[0], rank - before[1]
        evidence = delta_chi2 - rank * search.bic_penalty
        if evidence > REGRESSOR_EVIDENCE and (best is None or evidence > best.evidence):
            best = RemainingDependence(regressor, evidence, delta_chi2 - rank)
    return best


def common_mode(
    search: Search, missing: Sequence[str], found: Sequence[ScoredForm] = ()
) -> Dependence | None:
    """Return what the axes have in common beside the effects found; None where nothing.

    A course that all runs repeat from their start is one of time; one that every run has for
    itself is one of the supply where that was not logged, else of time as well.
    """
    common = coherence(search.design, [term for r in found for term in r.form.terms])
    if common.evidence < COMMON_MODE_EVIDENCE:
        return None
    suspects = [c for c in CHANNELS_OF[search.design.sensor] if c in missing and c in LOGGED]
    if common.runs < RUNS_IN_STEP_EVIDENCE and suspects:
        name = 'supply' if 'supply_voltage' in suspects else _suspect(suspects)
        return Dependence('unlogged', name, common.evidence)
    return Dependence('unexplained', 'time', common.evidence)


def dependence(
    search: Search,
    regressors: Sequence[GenericRegressor],
    missing: Sequence[str],
    found: Sequence[ScoredForm],
) -> Dependence:
    """Say on which variable the residual depends, or which channel is suspected."""
    design = search.design
    terms = [term for r in found for term in r.form.terms]
    everything, _ = explainable(search, regressors, terms)
    regressor, evidence, delta_chi2 = _law(search, regressors)
    evidence = max(evidence, search.total([r.form for r in found])[0])
    relevant = [c for c in CHANNELS_OF[design.sensor] if c in missing]
    suspects = [c for c in relevant if c in LOGGED]
    if regressor.depends_on == 'humidity' and 'humidity' in relevant:
        if best_hinge(search).evidence > evidence:
            return Dependence('unexplained', 'temperature', evidence)
        return Dependence('unlogged', 'humidity', evidence)
    adequate = delta_chi2 >= (WHOLE_SHARE if suspects else ADEQUATE) * everything
    plainly = regressor.depends_on in SWITCHED and _plainly(search, regressor)
    if design.sensor != 'magnetometer' and regressor.depends_on in SWITCHED:
        # A compressor reaches accelerometer and gyroscope by shaking them or through the supply.
        shaken = regressor.depends_on == 'compressor' and plainly
        if 'vibration' in missing and (shaken or not adequate):
            return Dependence('unlogged', 'vibration', evidence)
        if suspects:
            return Dependence('unlogged', _suspect(suspects), evidence)
        return Dependence('unexplained', regressor.depends_on, evidence)
    if suspects and not (adequate and (plainly or regressor.depends_on in CHAMBER_FREE)):
        return Dependence('unlogged', _suspect(suspects), evidence)
    vague = delta_chi2 < VAGUE_SHARE * everything
    if relevant and (
        vague or (not adequate and regressor.depends_on in {'phase', 'time', 'cycle'})
    ):
        return Dependence('unlogged', 'chamber', evidence)
    return Dependence('unexplained', regressor.depends_on, evidence)


def _law(
    search: Search, regressors: Sequence[GenericRegressor]
) -> tuple[GenericRegressor, float, float]:
    """Return the regressor that stands for the law, its evidence and its variable's Δχ².

    The strongest one, three standard deviations of what noise gives its columns aside, may be
    flexible enough to follow another variable's law: the one of fewest columns that explains
    nearly as much is preferred. Δχ² beyond noise is that of its variable's best regressor.
    """
    scored = []
    for regressor in regressors:
        delta_chi2, rank = search.design.solve([regressor.term])
        net = delta_chi2 - rank - 3.0 * float(np.sqrt(2.0 * rank))
        scored.append(
            (net, rank, delta_chi2 - rank * search.bic_penalty, delta_chi2 - rank, regressor)
        )
    best = max(net for net, *_ in scored)
    near = [item for item in scored if item[0] >= min(SIMPLER_SHARE * best, best)]
    _, _, evidence, _, regressor = min(near, key=lambda item: item[1])
    return (
        regressor,
        evidence,
        max(row[3] for row in scored if row[4].depends_on == regressor.depends_on),
    )


def explainable(
    search: Search, regressors: Sequence[GenericRegressor], terms: Sequence[ColumnGroup]
) -> tuple[float, float]:
    """Return Δχ² beyond noise of the terms and all regressors, and its spread by noise."""
    delta_chi2, rank = search.design.solve([*terms, *(regressor.term for regressor in regressors)])
    return delta_chi2 - rank, float(np.sqrt(2.0 * rank))


def _plainly(search: Search, regressor: GenericRegressor) -> bool:
    """Tell whether the channel by itself, its first column, explains most of what it can."""
    alone = search.design.solve([ColumnGroup(regressor.term.columns[:1])])[0]
    return alone >= PLAIN_SHARE * search.design.solve([regressor.term])[0]


def _suspect(channels: Sequence[str]) -> str:
    return channels[0].removesuffix('_voltage') if len(channels) == 1 else 'chamber'


def best_hinge(search: Search) -> Hinge:
    """Return the bend that explains most of the sensor's residual by itself.

    One coefficient per axis and one temperature: error = a · max(0, T − T_bend). A law of two
    coefficients that explains less is not the law.
    """
    runs = search.design.source.runs
    low = min(float(run.temperature.min()) for run in runs)
    high = max(float(run.temperature.max()) for run in runs)
    spacing = (high - low) / (BEND_COUNT + 1)
    even = [low + spacing * k for k in range(1, BEND_COUNT + 1)]
    best = max(_hinges(search, even), key=lambda h: h.evidence)
    for _ in range(BEND_REFINEMENTS):
        spacing *= 0.5
        beside = [best.temperature - spacing, best.temperature + spacing]
        best = max([best, *_hinges(search, beside)], key=lambda h: h.evidence)
    return best


def _hinges(search: Search, bends: Sequence[float]) -> list[Hinge]:
    terms = search.design.generic_terms([(_bent_at(bend), False) for bend in bends])
    found = []
    for bend, term in zip(bends, terms, strict=True):
        delta_chi2, rank = search.design.solve([term])
        found.append(Hinge(bend, delta_chi2 - (rank + 1) * search.bic_penalty, delta_chi2))
    return found


def _bent_at(bend: float) -> Callable[[PreparedRun], FloatArray]:
    def column(run: PreparedRun) -> FloatArray:
        return run.block_mean(np.maximum(run.conditions.temperature - bend, 0.0))[:, None]

    return column


def coherence(design: CandidateDesign, found: Sequence[ColumnGroup] = ()) -> Coherence:
    """Return the evidence for a course common to the axes in what the found effects leave.

    A course over time hides in a noise model that is rich enough to follow it, but noise is
    independent between axes and between runs. The slow half waves of each run, whitened and made
    orthogonal, are compared: −(n − 1 − (2 p + 5) / 6) ln det R − p (p − 1) / 2 · ln n, where R
    (p, p) correlates n waves of p axes, or of p runs along the axes' common direction (Bartlett's
    test of independence). The strongest of HALF_WAVE_COUNTS counts.
    """
    waves = _waves(design, found)
    axes = runs = -np.inf
    for span in HALF_WAVE_COUNTS:
        part = waves[:, :, :span]
        rows = part.reshape(len(part), -1)
        axes = max(axes, _dependence(rows))
        direction = np.linalg.eigh(rows @ rows.T)[1][:, -1]
        runs = max(runs, _dependence(np.einsum('a,ark->rk', direction, part)))
    return Coherence(float(axes), float(runs))


def _waves(design: CandidateDesign, found: Sequence[ColumnGroup]) -> FloatArray:
    """(3, runs, HALF_WAVES) amplitudes of the half waves, of unit variance for noise alone.

    With V the whitened half waves of a run, Q the base and r the residual, they are R⁻ᵀ Vᵀ r,
    Rᵀ R = Vᵀ V − (Qᵀ V)ᵀ Qᵀ V (Cholesky): as if V were made orthogonal to Q, then in itself.
    """
    runs = design.source.runs
    longest = max(float(run.time[-1]) for run in runs)
    known = design.whitened_columns(list(found))
    amplitudes = np.empty((3, len(runs), HALF_WAVES))
    for axis in range(3):
        target = design.target[axis]
        if found:
            target = target - known[axis] @ np.linalg.lstsq(known[axis], target, rcond=1e-9)[0]
        for number, run in enumerate(runs):
            half_turns = np.multiply.outer(run.time / longest, np.arange(1, HALF_WAVES + 1))
            white, rows = design.whitened_in_run(np.cos(np.pi * half_turns), number, axis)
            cross = design.base[axis][rows].T @ white
            normal = white.T @ white
            normal -= cross.T @ cross - ABSORBED_POWER_SHARE * np.diag(np.diag(normal))
            triangle = np.linalg.cholesky(normal)
            amplitudes[axis, number] = np.linalg.solve(triangle, white.T @ target[rows])
    return amplitudes


def _dependence(rows: FloatArray) -> float:
    """Return the evidence that the (p, n) rows depend on each other."""
    p, n = rows.shape
    power = (rows**2).sum(axis=1)
    if p < 2 or n < p + 1 or not (power > 0.0).all():
        return -np.inf
    correlation = rows @ rows.T / np.sqrt(np.outer(power, power))
    determinant = max(float(np.linalg.det(correlation)), 1e-300)
    weight = n - 1.0 - (2.0 * p + 5.0) / 6.0
    bic_penalty = 0.5 * p * (p - 1) * float(np.log(n))
    return float(-weight * np.log(determinant) - bic_penalty)
