# SPDX-License-Identifier: Apache-2.0
"""The stretches at rest of one sensor, pooled: curve, lag and levels, all logs or some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY, FloatArray, IntArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import EARTH_RATE_RAD_S, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.empirical_term import Empirical
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.linear.design import Design
from thermal_comp.linear.gaussian_evidence import log_sum
from thermal_comp.model.values import SensorModel
from thermal_comp.noise.of_runs import noise_of_runs
from thermal_comp.still.forms import COARSE_LAGS, CURVE_SIZE, CurveForm, forms_near
from thermal_comp.still.levels import LevelEquations, LevelSolution, solve_levels

FREE_STD = 1e6
"""Prior standard deviation of a polynomial that leaves it free; its size is estimated here."""
GRAVITY_STD = 0.015
"""Standard deviation of the gravity of a place about the standard one [m/s²]."""
OFFSET_STD = 1.0
"""Standard deviation of the zero-g level of an accelerometer [m/s²]."""
USUAL_SIGMA: dict[Sensor, FloatArray] = {
    'gyroscope': np.array([7e-4, 1e-4, 1e-3, 2e-5]),
    'accelerometer': np.array([0.02, 0.005, 0.02, 2e-4]),
}
"""Usual standard deviations of the level by power-on and by pose, of bends [unit], and of the
slope of a stretch about the curve's [unit/K]."""
LAG_STD: dict[Sensor, float] = {'gyroscope': 7e-4, 'accelerometer': 7e-3}
"""Prior standard deviation of a lag's coefficient: as the slope's [unit/K]."""
STEEPER_LAG_SHARE = 0.4
"""The same of what a lag is larger by towards the ends of the range, as a share of it."""
AGEING_STD: dict[Sensor, float] = {'gyroscope': 0.01, 'accelerometer': 0.5}
"""Prior standard deviation of the ageing of a level [unit a year]."""
YEAR_S = 365.25 * 86400.0
"""A year [s]."""
LEAST_DATE_SPAN_S = 86400.0
"""Span of dates from which ageing is estimated [s]."""
ODD_SIGMA = 6.0
"""Distance of a level from its prediction by the others, in standard deviations, from which it is
odd."""
LARGEST_ODD_SHARE = 0.1
"""Largest share of the stretches that is left out as odd."""
LEAST_LAG_LOG_EVIDENCE = 5.0
"""ln of the Bayes factor from which a lag is taken."""
LEARNING_RATE = 0.1
"""Weight of the evidence between forms, none of which is exact (Grünwald and van Ommen, Bayesian
Analysis 12(4), 2017): with 1 their spread would be too small."""
HELD_OUT_GROUPS = 10
"""Groups of logs that are held out one at a time."""
DIRECTION_STEPS = 2
"""Corrections of the direction of gravity; the first leaves an error below 0.1 mm/s²."""


@dataclass(frozen=True, eq=False)
class SensorCurve:
    """Levels, ageing and errors of one sensor, from many logs."""

    turn_on: FloatArray
    """(3,) standard deviation of the level from power-on to power-on [unit]."""
    pose: FloatArray
    """(3,) standard deviation that the pose of a stretch adds to it [unit]."""
    log_levels: FloatArray
    """(logs, 3) level of each log about that of all [unit]."""
    ageing: FloatArray
    """(2, 3) change of the level a year and its standard deviation [unit]; NaN where unknown."""
    raw: FloatArray
    """(3,) rms of block means about the level of their stretch: nothing subtracted [unit]."""
    held_out: FloatArray
    """(3,) the same with the curve of other logs subtracted [unit]."""


@dataclass(frozen=True, eq=False)
class _Answer:
    """Solutions, one for each group of axes that is solved together, with one form of curve."""

    each: Sequence[LevelSolution]
    form: CurveForm
    of_forms: FloatArray = field(default_factory=lambda: np.zeros((CURVE_SIZE, 3, CURVE_SIZE, 3)))
    """Covariance of the curve's coefficients from not knowing the form."""

    @property
    def log_evidence(self) -> float:
        """Ln of the marginal likelihood of all axes."""
        return sum(solution.log_evidence for solution in self.each)


class Pool:
    """The stretches of one sensor: equations of each, solved together or without some logs."""

    def __init__(
        self,
        runs: Sequence[PreparedRun],
        of_log: IntArray,
        ages: FloatArray,
        sensor: Sensor,
        span: tuple[float, float],
    ) -> None:
        """Take in stretches, the (stretches,) log of each, (logs,) ages, and the range [°C]."""
        self._runs, self._of_log, self._sensor = runs, of_log, sensor
        self._span = span
        middle, half = 0.5 * (span[0] + span[1]), max(0.5 * (span[1] - span[0]), 1.0)
        self._line = BiasTemperature()
        self._bends = Empirical(middle, half, (FREE_STD,) * 3)
        self._noise, guessed = noise_of_runs(runs, sensor, COARSE_LAGS)
        self.notes = [guessed] if guessed else []
        curve = {sensor: (self._line, self._bends)}
        self._designs = [Design([run.smoothed], curve, {sensor: self._noise}) for run in runs]
        for design in self._designs:
            design.equations()  # whitens the columns that every form has
        self._each: dict[CurveForm, list[tuple[FloatArray, FloatArray]]] = {}
        dated = np.isfinite(ages).all() and float(np.ptp(ages)) * YEAR_S >= LEAST_DATE_SPAN_S
        self._age = ages[of_log] if dated else None
        self._up = np.array([_direction(run) for run in runs])
        reference = runs[0].conditions.reference_temperature
        self._middle = [float(run.temperature.mean()) - reference for run in runs]
        self._axes = [(0, 1, 2)] if sensor == 'accelerometer' else [(0,), (1,), (2,)]
        self.odd: list[str] = []
        """Stretches that are left out, as their level is odd."""
        self._kept: NDArray[np.bool_] = np.ones(len(runs), bool)
        self._answer = self._without_odd()

    def _equations(self, form: CurveForm) -> list[tuple[FloatArray, FloatArray]]:
        """Return gram and moment of each stretch: 3 levels, then (p, 3) coefficients."""
        if form not in self._each:
            effects = form.effects(self._line, self._bends)
            found = []
            for base in self._designs:
                design = base.with_effects({self._sensor: effects})
                design.raw, design.white = dict(base.raw), dict(base.white)
                # The decays after gaps are left out: a stretch is too short for them.
                first = design.levels
                further = first + 3 * CURVE_SIZE
                own = np.r_[
                    :3,
                    first : first + 3 * CURVE_SIZE,
                    further : further + 3 * (form.coefficients - CURVE_SIZE),
                ]
                equations = design.equations()
                found.append((equations.gram[np.ix_(own, own)], equations.moment[own, 0]))
            self._each[form] = found
        return self._each[form]

    def _without_odd(self) -> _Answer:
        """Return the solution without odd stretches, which are left out from then on."""
        answer = self._searched()
        while len(self.odd) < LARGEST_ODD_SHARE * len(self._runs) and self._kept.sum() > 3:
            apart = np.max([solution.apart for solution in answer.each], axis=0)
            if not apart.max() > ODD_SIGMA:
                break
            row = int(np.flatnonzero(self._kept)[int(np.argmax(apart))])
            self.odd.append(self._runs[row].name)
            self._kept[row] = False
            answer = self._searched()
        return answer

    def _searched(self) -> _Answer:
        """Return the solution with the likeliest form, uncertain by how much the others differ."""
        none = CurveForm()
        for _ in range(DIRECTION_STEPS):
            self._turn_to_gravity(self._solved(self._kept, none))
        sigma = [solution.sigma for solution in self._solved(self._kept, none).each]
        coarse = [CurveForm(lag, tied) for lag in COARSE_LAGS for tied in (False, True)]
        tried = {form: self._solved(self._kept, form, sigma) for form in (none, *coarse)}
        best = max(tried, key=lambda form: tried[form].log_evidence)
        if tried[best].log_evidence < tried[none].log_evidence + LEAST_LAG_LOG_EVIDENCE:
            best = none
        if best.lag is not None:
            again = self._solved(self._kept, best)
            sigma = [solution.sigma for solution in again.each]
            tried = {form: self._solved(self._kept, form, sigma) for form in forms_near(best)}
            best = max(tried, key=lambda form: tried[form].log_evidence)
        worth = np.array([one.log_evidence for one in tried.values()])
        worth *= LEARNING_RATE
        weight = np.exp(worth - log_sum(worth))
        n = int(self._kept.sum())
        curves = np.array([self._unpacked(one, n)[1][:CURVE_SIZE] for one in tried.values()])
        off = curves - curves[list(tried).index(best)]
        spread = np.einsum('k,kpa,kqb->paqb', weight, off, off)
        return replace(self._solved(self._kept, best), of_forms=spread)

    def _turn_to_gravity(self, answer: _Answer) -> None:
        """Take an accelerometer's known error off the direction of gravity in each stretch."""
        if len(answer.each) > 1:
            return
        (solution,), rows = answer.each, np.flatnonzero(self._kept)
        levels = solution.estimate[: 3 * len(rows)].reshape(-1, 3)
        common = len(self._of_levels(rows)[3])
        error = solution.estimate[-common:][:3]
        self._up[rows] = (levels - error) / np.linalg.norm(levels - error, axis=1)[:, None]

    def _solved(
        self, kept: NDArray[np.bool_], form: CurveForm, sigma: Sequence[FloatArray] | None = None
    ) -> _Answer:
        """Return the solution of some stretches; `sigma` keeps variances that are known."""
        rows = np.flatnonzero(kept)
        each = [
            solve_levels(self._joined(rows, axes, form), None if sigma is None else sigma[number])
            for number, axes in enumerate(self._axes)
        ]
        return _Answer(each, form)

    def _joined(self, rows: IntArray, axes: tuple[int, ...], form: CurveForm) -> LevelEquations:
        """Return the equations of some stretches: levels, coefficients, slopes of stretches.

        The axis comes last in each.
        """
        a, m, terms = len(axes), len(rows), form.coefficients
        p, n = terms * a, m * a
        gram, moment = np.zeros((2 * n + p, 2 * n + p)), np.zeros(2 * n + p)
        own = np.array([3 * row + axis for row in range(1 + terms) for axis in axes])
        every = self._equations(form)
        for number, row in enumerate(rows):
            at = number * a + np.arange(a)
            place = np.concatenate([at, n + np.arange(p), n + p + at])
            part, right = every[row]
            # A slope of its own turns a stretch about its middle.
            turned = np.concatenate([np.eye(a + p), np.zeros((a + p, a))], axis=1)
            turned[np.arange(a), a + p + np.arange(a)] = -self._middle[row]
            turned[a + np.arange(a), a + p + np.arange(a)] = 1.0
            gram[np.ix_(place, place)] += turned.T @ part[np.ix_(own, own)] @ turned
            moment[place] += turned.T @ right[own]
        std = np.full(terms, np.inf)
        std[CURVE_SIZE:] = LAG_STD[self._sensor]
        std[CURVE_SIZE + 1 :] *= STEEPER_LAG_SHARE
        bending = np.full(terms, np.inf)
        bending[1:CURVE_SIZE] = 1.0
        free = np.full(n, np.inf)
        seen, target, common, common_std, alike = self._of_levels(rows)
        return LevelEquations(
            gram=gram,
            moment=moment,
            seen=seen,
            target=target,
            common=common,
            common_std=common_std,
            same_log=(self._of_log[rows][:, None] == self._of_log[rows]) * alike,
            floor=np.full(m, EARTH_RATE_RAD_S**2 / 3.0 if a == 1 else 0.0),
            fixed=np.concatenate([np.repeat(std, a), free]),
            bending=np.concatenate([np.repeat(bending, a), free]),
            slopes=np.arange(p + n) >= p,
            usual=USUAL_SIGMA[self._sensor],
        )

    def _of_levels(
        self, rows: IntArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return U, t, H, prior deviations of γ, and correlation of power-ons by pose."""
        k = len(rows)
        ageing = AGEING_STD[self._sensor]
        if len(self._axes) > 1:
            common, std = np.ones((k, 1)), np.array([np.inf])
            if self._age is not None:
                common, std = np.column_stack([common, self._age[rows]]), np.append(std, ageing)
            return np.eye(k), np.zeros(k), common, std, np.ones((k, k))
        up = self._up[rows]
        seen = np.zeros((k, 3 * k))
        seen[np.repeat(np.arange(k), 3), np.arange(3 * k)] = up.ravel()
        common = np.column_stack([up, np.ones(k)])
        std = np.array([OFFSET_STD] * 3 + [GRAVITY_STD])
        if self._age is not None:
            common = np.column_stack([common, up * self._age[rows, None]])
            std = np.append(std, [ageing] * 3)
        return seen, np.full(k, STANDARD_GRAVITY), common, std, up @ up.T

    def model(self) -> SensorModel:
        """Return the solution as the model of the sensor."""
        answer, rows = self._answer, np.flatnonzero(self._kept)
        levels, found, covariance = self._unpacked(answer, len(rows))
        size = np.zeros(3)
        for solution, axes in zip(answer.each, self._axes, strict=True):
            size[list(axes)] = solution.sigma[2]
        bends = replace(self._bends, deviations=tuple(size.tolist()))
        lag = () if answer.form.lag is None else (answer.form.lag,)
        effects: tuple[Effect, ...] = (self._line, bends, *lag)
        split = np.split(found, [1, CURVE_SIZE][: len(effects) - 1])
        return SensorModel(
            effects=effects,
            coefficients=tuple(split),
            covariance=covariance.reshape(found.size, found.size),
            noise=self._noise,
            levels={self._runs[r].name: levels[k] for k, r in enumerate(rows.tolist())},
            contributions={e.name: self._rms(e, c) for e, c in zip(effects, split, strict=True)},
            temperature_range=self._span,
        )

    def _unpacked(self, answer: _Answer, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return levels (n, 3), coefficients (p, 3) and their covariance (p, 3, p, 3)."""
        p = answer.form.coefficients
        levels, found = np.zeros((n, 3)), np.zeros((p, 3))
        covariance = np.zeros((p, 3, p, 3))
        for solution, axes in zip(answer.each, self._axes, strict=True):
            a, own = len(axes), slice(n * len(axes), (n + p) * len(axes))
            index = np.array(axes)
            levels[:, index] = solution.estimate[: n * a].reshape(n, a)
            found[:, index] = solution.estimate[own].reshape(p, a)
            part = solution.covariance[own, own].reshape(p, a, p, a)
            covariance[np.ix_(np.arange(p), index, np.arange(p), index)] = part
        covariance[:CURVE_SIZE, :, :CURVE_SIZE] += answer.of_forms
        if answer.form.lag is None:
            return levels, found, covariance
        wide = np.zeros((CURVE_SIZE + 1, 3, CURVE_SIZE + 1, 3))
        if answer.form.tied:
            found = np.concatenate([found, self._slope_of(found, answer.form.lag)])
            wide[:CURVE_SIZE, :, :CURVE_SIZE] = covariance
            return levels, found, wide
        wide[:] = covariance[: CURVE_SIZE + 1, :, : CURVE_SIZE + 1]
        return levels, found[: CURVE_SIZE + 1], wide

    def _slope_of(self, curve: FloatArray, lag: ThermalLag) -> FloatArray:
        """Return the (1, 3) coefficient of the lag that comes nearest to the curve behind it."""
        behind = np.concatenate([run.columns(lag, self._sensor) for run in self._runs])[:, 0]
        effects = self._line, self._bends
        now, then = (
            np.concatenate([
                np.concatenate([run.columns(e, self._sensor) for e in form], axis=1)
                for run in self._runs
            ])[:, :CURVE_SIZE]
            for form in (effects, CurveForm(lag, tied=True).effects(*effects))
        )  # fmt: skip
        slope: FloatArray = behind[None] @ ((then - now) @ curve) / max(behind @ behind, 1e-300)
        return slope

    def _rms(self, effect: Effect, coefficients: FloatArray) -> FloatArray:
        """Return (3,) rms of an effect's error about the mean of all stretches."""
        columns = [run.columns(effect, self._sensor) for run in self._runs]
        rms: FloatArray = (np.concatenate(columns) @ coefficients).std(axis=0)
        return rms

    def sensor_curve(self) -> SensorCurve:
        """Return the spread of levels, ageing, and errors before and after on held-out logs."""
        answer, rows = self._answer, np.flatnonzero(self._kept)
        ageing = np.full((2, 3), np.nan)
        of_logs = np.zeros((int(self._of_log.max()) + 1, 3))
        for solution, axes in zip(answer.each, self._axes, strict=True):
            equations = self._joined(rows, axes, answer.form)
            inside, a = len(equations.moment), len(axes)
            if self._age is not None:
                last = slice(len(solution.estimate) - a, None)
                deviation = np.sqrt(np.diag(solution.covariance)[last])
                # Age counts backwards in time.
                ageing[:, list(axes)] = -solution.estimate[last], deviation
            left = equations.seen @ solution.estimate[: equations.seen.shape[1]]
            left -= equations.target + equations.common @ solution.estimate[inside:]
            turn, pose = solution.sigma[0] ** 2, solution.sigma[1] ** 2 + equations.floor
            weighed = np.linalg.solve(turn * equations.same_log + np.diag(pose), left)
            directions = self._up[rows] if a == 3 else np.ones((len(rows), 1))
            for axis, along in zip(axes, directions.T, strict=True):
                np.add.at(of_logs[:, axis], self._of_log[rows], turn * along * weighed)
        sigma = np.repeat([s.sigma[:2] for s in answer.each], [len(a) for a in self._axes], 0)
        raw, held_out = self._held_out()
        return SensorCurve(
            turn_on=sigma[:, 0],
            pose=sigma[:, 1],
            log_levels=of_logs,
            ageing=ageing,
            raw=raw,
            held_out=held_out,
        )

    def _held_out(self) -> tuple[FloatArray, FloatArray]:
        """Return (3,) rms about the level of each stretch, before and after, logs held out.

        Not by `comparison.held_out`: levels are solved for together, beyond a design's equations.
        """
        sigma = [solution.sigma for solution in self._answer.each]
        logs = np.unique(self._of_log[self._kept])
        if len(logs) < 2:
            return np.full(3, np.nan), np.full(3, np.nan)
        form = self._answer.form
        effects = (self._line, self._bends, *(() if form.lag is None else (form.lag,)))
        before, after = [], []
        for group in range(min(HELD_OUT_GROUPS, len(logs))):
            held = np.isin(self._of_log, logs[group::HELD_OUT_GROUPS])
            others = self._kept & ~held
            found = self._unpacked(self._solved(others, form, sigma), int(others.sum()))[1]
            for row in np.flatnonzero(self._kept & held).tolist():
                run = self._runs[row]
                columns = np.concatenate([run.columns(e, self._sensor) for e in effects], 1)
                used = np.r_[
                    :CURVE_SIZE,
                    columns.shape[1] - len(found) + CURVE_SIZE : columns.shape[1],
                ]
                measured = run.measured[self._sensor]
                left = measured - columns[:, used] @ found
                before.append(measured - np.nanmean(measured, axis=0))
                after.append(left - np.nanmean(left, axis=0))
        rms = [np.sqrt(np.nanmean(np.concatenate(part) ** 2, axis=0)) for part in (before, after)]
        return rms[0], rms[1]


def _direction(run: PreparedRun) -> FloatArray:
    """Return (3,) direction of gravity in a stretch."""
    mean = np.nanmean(run.measured['accelerometer'], axis=0)
    direction: FloatArray = mean / np.linalg.norm(mean)
    return direction
