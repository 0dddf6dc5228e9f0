# SPDX-License-Identifier: Apache-2.0
"""The thermal cycle that best tells two rival effects apart (T-optimality, Atkinson and Fedorov).

The evidence a plan promises is the whitened sum of squares one effect leaves unexplained by its
rival and by the rest of the model, the smaller of both directions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.conditions import Conditions, Sensor
from thermal_comp.diagnose_candidates import shape_grid
from thermal_comp.effects.effect import Effect
from thermal_comp.experiment_plan import PAPER, PERIOD_S, Plan, Segment, predict_runs
from thermal_comp.model import ModelError, NoiseModel, ThermalModel
from thermal_comp.whitening import apply_gains, innovation_gains

SEPARABLE = 20.0
"""Evidence from which two effects count as told apart."""
HOPELESS = 10.0
LEAST_REPEATS = 3
"""Cycles that stay, so that one can be left out."""
FEWEST_SHAPES = 5
ACTIONS = {
    'scale_factor_temperature': 'flip: add a run with one axis pointing down',
    'misalignment_temperature': 'flip: add a run with one axis pointing down',
    'fixture_tilt': 'flip: add a run with one axis pointing down',
    'fixture_hard_iron': 'flip: add a run with one axis pointing down',
    'thermal_gradient': 'log a second thermometer and change the heat path (fan speed)',
    'temperature_rate': 'change the heat path (fan speed) at the same profile',
    'warm_up': 'power cycle in the middle of a dwell',
    'bias_creep': 'power cycle in the middle of a dwell; soak ten times the expected t₀',
    'bias_drift': 'soak at constant temperature with the power on',
    'turn_on_bias': 'keep the power on between the cycles',
    'bias_step': 'repeat the run',
    'heater_hard_iron': 'log the heater current; switch the heater at constant temperature',
    'compressor_hard_iron': 'log the compressor; switch it at constant temperature',
    'icing': 'purge with dry gas; stay 2 K above and below 0 °C',
    'humidity': 'log humidity; purge with dry gas',
    'supply_sensitivity': 'log and step the supply voltage',
    'vibration_rectification': 'log vibration; run the compressor at constant temperature',
    'mains_alias': 'change the output data rate',
    'g_sensitivity_temperature': 'flip: add a run with one axis pointing down',
}
"""What helps beside temperature, by effect."""


@dataclass(frozen=True)
class Limits:
    """What the chamber may do."""

    low: float = -10.0
    high: float = 50.0
    max_rate: float = 2.0
    """[°C/min]."""
    hours: float = 12.0


@dataclass(frozen=True, eq=False)
class Proposal:
    """The plan that separates best, with the evidence it promises."""

    plan: Plan
    sensor: Sensor
    evidence_before: float
    """Promised by the paper's plan."""
    evidence_after: float
    separable: bool
    actions: tuple[str, ...]


def design_experiment(
    names: tuple[str, str],
    model: ThermalModel,
    limits: Limits,
    catalogue: dict[str, type[Effect]],
    *,
    seed: int = 0,
    evaluations: int = 160,
) -> Proposal:
    """Return the plan within the limits that best tells two effects apart."""
    unknown = [name for name in names if name not in catalogue]
    if unknown:
        raise ModelError(f'effect {unknown[0]!r} is not known; known: {", ".join(catalogue)}')
    if names[0] == names[1]:
        raise ModelError(f'{names[0]} and {names[1]} are the same effect')
    sensor = _sensor(names, model, catalogue)
    rivals = tuple(_Rival.of(name, model, sensor, catalogue) for name in names)
    noise = model.sensors[sensor].noise
    if noise is None:
        raise ModelError(f'sensors.{sensor}.noise: the model has none; fit it again')
    base = [e for e in model.sensors[sensor].effects if e.name not in names]

    def promise(plan: Plan, up_axes: Sequence[str] = ('+x', '+y', '+z')) -> float:
        bench = _Bench(predict_runs(plan, up_axes), sensor, noise, base)
        one, other = rivals
        return min(bench.evidence(one, other), bench.evidence(other, one))

    before = promise(_within(PAPER, limits))
    plan, after = _search(promise, limits, np.random.default_rng(seed), evaluations)
    if after < before:
        plan, after = _within(PAPER, limits), before
    actions = (
        []
        if after >= SEPARABLE
        else list(dict.fromkeys(ACTIONS[n] for n in names if n in ACTIONS))
    )
    if after < SEPARABLE and promise(plan, ('+x', '+y', '+z', '-z')) >= SEPARABLE:
        actions.insert(0, 'flip: add a run with the z axis down')
    return Proposal(plan, sensor, before, after, after >= SEPARABLE, tuple(dict.fromkeys(actions)))


@dataclass(frozen=True, eq=False)
class _Rival:
    """An effect with the size it is expected to have, and its other forms."""

    effect: Effect
    coefficients: FloatArray | None
    """As fitted; None: rms of one standard deviation of a one-second mean (M = 1)."""
    forms: tuple[Effect, ...]

    @classmethod
    def of(
        cls, name: str, model: ThermalModel, sensor: Sensor, catalogue: dict[str, type[Effect]]
    ) -> _Rival:
        part = model.sensors[sensor]
        for effect, coefficients in zip(part.effects, part.coefficients, strict=True):
            if effect.name == name:
                return cls(effect, coefficients, (effect, *_forms(catalogue[name])))
        effect = catalogue[name]()
        return cls(effect, None, (effect, *_forms(catalogue[name])))


def _forms(effect: type[Effect]) -> list[Effect]:
    return shape_grid(effect, FEWEST_SHAPES)


class _Bench:
    """Whitened columns of predicted runs."""

    def __init__(
        self,
        runs: Sequence[Conditions],
        sensor: Sensor,
        noise: NoiseModel,
        base: Sequence[Effect],
    ) -> None:
        self.runs = [run.of(sensor) for run in runs]
        self.noise = noise
        slot: IntArray = np.arange(len(runs[0]), dtype=np.int64)
        self._gains = [innovation_gains(slot, noise, axis, PERIOD_S) for axis in range(3)]
        known = np.concatenate([self._levels(), *(self._columns(e) for e in base)], axis=2)
        self._base = [_orthonormal(known[axis]) for axis in range(3)]

    def evidence(self, truth: _Rival, rival: _Rival) -> float:
        """Return what of the truth the rival's best form leaves, in whitened sum of squares."""
        raw = self._raw(truth.effect)
        signal = np.einsum('nap,pa->na', raw, self._sizes(truth, raw))
        if truth.coefficients is None:
            signal *= float(np.mean(self.noise.white)) / max(self._size(signal), 1e-300)
        whitened = self._whitened(signal[:, :, None])[:, :, 0]
        left = [self._without_base(whitened[a][:, None], a)[:, 0] for a in range(3)]
        signal = np.stack(left)
        return min(self._left(signal, form) for form in rival.forms)

    def _size(self, signal: FloatArray) -> float:
        """Return the rms (rows, 3) has beyond levels of the runs and a line in temperature."""
        rows = len(self.runs[0])
        parts = [signal[k * rows : (k + 1) * rows] for k in range(len(self.runs))]
        centred = np.concatenate([part - part.mean(axis=0) for part in parts])
        x = np.concatenate([run.temperature - run.temperature.mean() for run in self.runs])
        rest = centred - np.outer(x, x @ centred / (x @ x))
        return float(np.sqrt((rest**2).mean()))

    def _sizes(self, rival: _Rival, columns: FloatArray) -> FloatArray:
        count = columns.shape[2]
        if rival.coefficients is None:
            sizes: FloatArray = np.sqrt((columns**2).mean(axis=(0, 1)))
            return np.repeat((1.0 / np.maximum(sizes, 1e-300))[:, None], 3, axis=1)
        fitted = rival.coefficients
        if rival.effect.per_run:
            fitted = fitted.reshape(-1, *fitted.shape[2:]) if fitted.ndim == 3 else fitted.ravel()
        if fitted.ndim == 1:
            fitted = np.repeat(fitted[:, None], 3, axis=1)
        return fitted[:count] if len(fitted) >= count else np.resize(fitted, (count, 3))

    def _left(self, signal: FloatArray, form: Effect) -> float:
        columns = self._columns(form)
        if form.columns(self.runs[0])[0].ndim == 3:
            stacked = np.concatenate([self._without_base(columns[a], a) for a in range(3)])
            basis = _orthonormal(stacked)
            flat = signal.ravel()
            return float(((flat - basis @ (basis.T @ flat)) ** 2).sum())
        left = 0.0
        for axis in range(3):
            basis = _orthonormal(self._without_base(columns[axis], axis))
            rest = signal[axis] - basis @ (basis.T @ signal[axis])
            left += float((rest**2).sum())
        return left

    def _without_base(self, columns: FloatArray, axis: int) -> FloatArray:
        basis = self._base[axis]
        return np.asarray(columns - basis @ (basis.T @ columns))

    def _levels(self) -> FloatArray:
        runs, rows = len(self.runs), len(self.runs[0])
        levels = np.kron(np.eye(runs), np.ones((rows, 1)))
        return self._whitened(np.repeat(levels[:, None, :], 3, axis=1))

    def _columns(self, effect: Effect) -> FloatArray:
        return self._whitened(self._raw(effect))

    def _raw(self, effect: Effect) -> FloatArray:
        """(rows, 3, p) columns of all runs below each other."""
        parts = []
        for number, run in enumerate(self.runs):
            columns: FloatArray = effect.columns(run)[0]
            if columns.ndim == 2:
                columns = np.repeat(columns[:, None, :], 3, axis=1)
            if effect.per_run:
                place = np.zeros((len(self.runs), 1))
                place[number] = 1.0
                spread = np.kron(place.T, columns.reshape(len(columns) * 3, -1))
                columns = np.asarray(spread.reshape(len(columns), 3, -1), dtype=np.float64)
            parts.append(np.asarray(columns, dtype=np.float64))
        return np.concatenate(parts)

    def _whitened(self, columns: FloatArray) -> FloatArray:
        rows = len(self.runs[0])
        parts = [columns[k * rows : (k + 1) * rows] for k in range(len(self.runs))]
        return np.stack(
            [
                np.concatenate([apply_gains(part[:, axis], self._gains[axis]) for part in parts])
                for axis in range(3)
            ]
        )


def _orthonormal(columns: FloatArray) -> FloatArray:
    size = np.linalg.norm(columns, axis=0)
    kept = columns[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    if not kept.shape[1]:
        return np.zeros((len(columns), 0))
    left, weights, _ = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), full_matrices=False)
    return np.asarray(left[:, weights > 1e-7 * weights[0]])


def _sensor(
    names: tuple[str, str], model: ThermalModel, catalogue: dict[str, type[Effect]]
) -> Sensor:
    """Return the sensor whose model holds one of the effects, else one both can act on."""
    both = [s for s in catalogue[names[0]].sensors if s in catalogue[names[1]].sensors]
    both = [s for s in both if s in model.sensors]
    if not both:
        raise ModelError(f'{names[0]} and {names[1]} act on no common sensor of the model')
    holding = [s for s in both if {e.name for e in model.sensors[s].effects} & set(names)]
    return (holding or both)[0]


def _within(plan: Plan, limits: Limits) -> Plan:
    """Return the plan cut to the limits, with as many repeats as the time allows."""
    cycle = tuple(
        Segment(
            float(np.clip(s.target, limits.low, limits.high)),
            min(s.rate, limits.max_rate),
            s.dwell,
        )
        for s in plan.cycle
    )
    for repeats in range(8, LEAST_REPEATS - 1, -1):
        if Plan(cycle, repeats).hours <= limits.hours:
            return Plan(cycle, repeats)
    shorter = tuple(replace(s, dwell=s.dwell * 0.7) for s in cycle)
    if min(s.dwell for s in shorter) < 120.0:
        raise ModelError(
            f'{limits.hours:g} h are too short for {LEAST_REPEATS} cycles between '
            f'{limits.low:g} and {limits.high:g} °C at {limits.max_rate:g} °C/min'
        )
    return _within(Plan(shorter, LEAST_REPEATS), limits)


def _search(
    promise: Callable[[Plan], float],
    limits: Limits,
    rng: np.random.Generator,
    evaluations: int,
) -> tuple[Plan, float]:
    """Exchange search: change, insert or drop one segment at a time, several starts."""
    best = _within(PAPER, limits)
    best_value = promise(best)
    starts = 4
    for start in range(starts):
        plan = best if start == 0 else _within(Plan(_random_cycle(limits, rng), 4), limits)
        value = promise(plan)
        for _ in range(evaluations // starts):
            trial = _changed(plan, limits, rng)
            if trial is None:
                continue
            reached = promise(trial)
            if reached > value:
                plan, value = trial, reached
        if value > best_value:
            best, best_value = plan, value
    return best, best_value


def _random_segment(limits: Limits, rng: np.random.Generator) -> Segment:
    return Segment(
        float(np.round(rng.uniform(limits.low, limits.high))),
        float(rng.choice([0.5, 1.0, limits.max_rate, limits.max_rate])),
        float(rng.choice([300.0, 600.0, 1200.0, 1800.0, 3600.0])),
    )


def _random_cycle(limits: Limits, rng: np.random.Generator) -> tuple[Segment, ...]:
    inner = tuple(_random_segment(limits, rng) for _ in range(int(rng.integers(2, 5))))
    return _closed(inner, limits)


def _closed(inner: tuple[Segment, ...], limits: Limits) -> tuple[Segment, ...]:
    """Return the cycle ending at the reference temperature."""
    home = float(np.clip(20.0, limits.low, limits.high))
    return (*inner, Segment(home, limits.max_rate, 900.0))


def _changed(plan: Plan, limits: Limits, rng: np.random.Generator) -> Plan | None:
    inner = list(plan.cycle[:-1])
    act = rng.choice(['change', 'change', 'insert', 'drop'])
    place = int(rng.integers(len(inner)))
    if act == 'drop' and len(inner) > 2:
        inner.pop(place)
    elif act == 'insert' and len(inner) < 7:
        inner.insert(place, _random_segment(limits, rng))
    else:
        inner[place] = _random_segment(limits, rng)
    try:
        return _within(Plan(_closed(tuple(inner), limits), 4), limits)
    except ModelError:
        return None
