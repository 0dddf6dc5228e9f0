# SPDX-License-Identifier: Apache-2.0
"""The stacked, whitened design of one or more sensors that share coefficients.

The form of one of its terms may be free: everything else is then eliminated once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.normal_equations import Factor, NormalEquations, factor
from thermal_comp.linear.whitening import RowWhitening
from thermal_comp.model.values import NoiseModel

LEAST_DEVIATION = 1e-15
"""Prior standard deviation of a coefficient that is as good as zero [unit]."""

Rows = Sequence[NDArray[np.bool_]]
"""Which blocks of each run take part."""
RightHandSides = Mapping[tuple[int, Sensor], FloatArray]
"""(m, 3, q) values over the blocks of a run, by run number and sensor."""


def prior_precision(deviations: FloatArray) -> FloatArray:
    """Return what prior standard deviations of coefficients add to the diagonal of XᵀX."""
    precision: FloatArray = 1.0 / np.maximum(deviations, LEAST_DEVIATION) ** 2
    return precision


@dataclass(frozen=True)
class Term:
    """One effect of a group of sensors and where its coefficients stand among the unknowns."""

    effect: Effect
    sensors: tuple[Sensor, ...]
    start: int
    shape: tuple[int, ...]
    """(p, 3), (p,), (runs, p, 3) or (runs, p)."""

    @property
    def unknowns(self) -> slice:
        """Return where the coefficients stand, in C order."""
        return slice(self.start, self.start + int(np.prod(self.shape)))

    def indices(self, run: int, axis: int, width: int) -> IntArray:
        """Return the unknowns that multiply the first `width` columns of one run and axis."""
        place = np.arange(int(np.prod(self.shape)), dtype=np.int64).reshape(self.shape)
        if self.effect.per_run:
            place = place[run]
        chosen: IntArray = self.start + (place[:, axis] if place.ndim == 2 else place)
        return chosen[:width]


@dataclass(eq=False)
class Design:
    """Columns of the effects of a group of sensors, over prepared runs, whitened on demand.

    Unknowns are the levels of every run, sensor and axis, what gaps leave behind there, then the
    coefficients in order of effects, so that of dependent columns the later one is held.
    """

    runs: Sequence[PreparedRun]
    effects: Mapping[Sensor, tuple[Effect, ...]]
    noise: Mapping[Sensor, NoiseModel]
    rows: Rows | None = None
    raw: dict[tuple[Effect, int, Sensor], FloatArray] = field(default_factory=dict)
    """Columns over all blocks; may be shared by designs of the same runs."""
    white: dict[tuple[Effect | None, int, Sensor, int], FloatArray] = field(default_factory=dict)
    whitenings: dict[Sensor, RowWhitening] = field(default_factory=dict)
    taken: dict[tuple[int, Sensor], NDArray[np.bool_]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.sensors = tuple(self.effects)
        first = 3 * len(self.runs) * len(self.sensors)
        widths = [3 * len(self.sensors) * run.after_gaps.shape[1] for run in self.runs]
        self.after_gaps = first + np.cumsum([0, *widths])
        """(runs + 1,) where the unknowns of decays after gaps start, run by run, and end."""
        self.levels = int(self.after_gaps[-1])
        self.terms = self._terms()
        self.size = self.terms[-1].unknowns.stop if self.terms else self.levels

    def with_effects(self, effects: Mapping[Sensor, tuple[Effect, ...]]) -> Design:
        """Return the design of other effects on the same rows, sharing what is computed."""
        return replace(self, effects=effects)

    @property
    def weighted(self) -> Design:
        """The design whitened by the weights of a fit, where these are not those of the noise."""
        weights = {sensor: noise.weights for sensor, noise in self.noise.items()}
        if all(weights[sensor] is self.noise[sensor] for sensor in self.sensors):
            return self
        return replace(self, noise=weights, white={}, whitenings={})

    def over(self, rows: Rows) -> Design:
        """Return the design over other blocks, sharing the columns."""
        return replace(self, rows=rows, white={}, whitenings={}, taken={})

    def level_index(self, run: int, sensor: Sensor, axis: int) -> int:
        """Return the unknown that is the level of a run, sensor and axis."""
        return (run * len(self.sensors) + self.sensors.index(sensor)) * 3 + axis

    def standing(self, run: int, sensor: Sensor, axis: int) -> tuple[IntArray, FloatArray]:
        """Return the unknowns of one axis whatever the effects, and their columns (m, 1 + q).

        They are its level and the decays after gaps.
        """
        columns = self.runs[run].level_columns
        width = columns.shape[1] - 1
        first = self.after_gaps[run] + (3 * self.sensors.index(sensor) + axis) * width
        index = np.append(self.level_index(run, sensor, axis), first + np.arange(width))
        return index, columns

    def valid(self, run: int, sensor: Sensor) -> NDArray[np.bool_]:
        """Return the (m,) blocks of a run that take part."""
        if (run, sensor) not in self.taken:
            finite = self.runs[run].valid(sensor)
            self.taken[run, sensor] = finite if self.rows is None else finite & self.rows[run]
        return self.taken[run, sensor]

    def columns(self, effect: Effect, run: int, sensor: Sensor) -> FloatArray:
        """Return the effect's (m, p) or (m, 3, p) columns over all blocks of a run."""
        key = (effect, run, sensor)
        if key not in self.raw:
            self.raw[key] = self.runs[run].columns(effect, sensor)
        return self.raw[key]

    def terms_of(self, sensor: Sensor) -> list[Term]:
        """Return the terms that act on a sensor, in its order of effects."""
        return [
            next(t for t in self.terms if t.effect == effect and sensor in t.sensors)
            for effect in self.effects[sensor]
        ]

    def predicted(self, estimate: FloatArray, run: int, sensor: Sensor) -> FloatArray:
        """Return the (m, 3, …) part of the effects for estimates (unknowns, …)."""
        total = np.zeros((len(self.runs[run]), 3, *estimate.shape[1:]))
        for term in self.terms_of(sensor):
            columns = self.columns(term.effect, run, sensor)
            for axis in range(3):
                part = columns[:, axis] if columns.ndim == 3 else columns
                place = term.indices(run, axis, part.shape[1])
                total[:, axis] += np.tensordot(part, estimate[place], 1)
        return total

    def offsets(self, estimate: FloatArray, run: int, sensor: Sensor) -> FloatArray:
        """Return the (m, 3) level and decays after gaps for an estimate (unknowns,)."""
        parts = [self.standing(run, sensor, axis) for axis in range(3)]
        return np.stack([columns @ estimate[place] for place, columns in parts], axis=1)

    def describe(self, unknown: int) -> str:
        """Return what an unknown is, in words."""
        if unknown >= self.after_gaps[0] and unknown < self.levels:
            run = int(np.searchsorted(self.after_gaps, unknown, side='right')) - 1
            return f'decay after a gap of run {self.runs[run].name}'
        if unknown < self.levels:
            run, rest = divmod(unknown, 3 * len(self.sensors))
            return f'level of run {self.runs[run].name} {"xyz"[rest % 3]}'
        term = next(t for t in self.terms if unknown < t.unknowns.stop)
        place = [int(i) for i in np.unravel_index(unknown - term.start, term.shape)]
        run_name = f' run {self.runs[place[0]].name}' if term.effect.per_run else ''
        place = place[1:] if term.effect.per_run else place
        column = f'[{place[0]}]' if term.shape[-2 if len(place) == 2 else -1] > 1 else ''
        axis = f' {"xyz"[place[1]]}' if len(place) == 2 else ''
        return f'{term.effect.name}{column}{run_name}{axis}'

    def equations(self, values: RightHandSides | None = None) -> NormalEquations:
        """Return the normal equations; `values` None takes what was measured."""
        q = 1 if values is None else next(iter(values.values())).shape[2]
        gram, moment = np.zeros((self.size, self.size)), np.zeros((self.size, q))
        energy, rows = np.zeros(q), 0
        for run, sensor, axis in self.pieces():
            index, columns, right = self.piece(run, sensor, axis, values)
            gram[np.ix_(index, index)] += columns.T @ columns
            moment[index] += columns.T @ right
            energy += (right**2).sum(axis=0)
            rows += len(right)
        for term in self.terms:
            deviations = term.effect.coefficient_deviations()
            if deviations is not None:
                place = np.arange(term.unknowns.start, term.unknowns.stop)
                gram[place, place] += prior_precision(deviations).ravel()
        return NormalEquations(gram, moment, energy, rows)

    def pieces(self) -> list[tuple[int, Sensor, int]]:
        """Return run, sensor and axis of all that is whitened by itself."""
        return [
            (run, sensor, axis)
            for run in range(len(self.runs))
            for sensor in self.sensors
            if self.valid(run, sensor).any()
            for axis in range(3)
        ]

    def piece(
        self, run: int, sensor: Sensor, axis: int, values: RightHandSides | None = None
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return unknowns, whitened columns and whitened right-hand sides of one axis."""
        key = (None, run, sensor, axis)
        valid = self.valid(run, sensor)
        place, standing = self.standing(run, sensor, axis)
        if key not in self.white:
            base = np.column_stack([standing, self.runs[run].measured[sensor][:, axis]])[valid]
            self.white[key] = self.whitened(base, run, sensor, axis)
        base_white = self.white[key]
        right = base_white[:, -1:]
        if values is not None:
            right = self.whitened(values[run, sensor][valid, axis], run, sensor, axis)
        index, columns = [place], [base_white[:, :-1]]
        for term in self.terms_of(sensor):
            columns.append(self._white_columns(term.effect, run, sensor, axis))
            index.append(term.indices(run, axis, columns[-1].shape[1]))
        return np.concatenate(index), np.concatenate(columns, axis=1), right

    def _white_columns(self, effect: Effect, run: int, sensor: Sensor, axis: int) -> FloatArray:
        key = (effect, run, sensor, axis)
        if key not in self.white:
            columns = self.columns(effect, run, sensor)
            part = columns[:, axis] if columns.ndim == 3 else columns
            part = part[self.valid(run, sensor)]
            self.white[key] = self.whitened(part, run, sensor, axis)
        return self.white[key]

    def whitening(self, sensor: Sensor) -> RowWhitening:
        """Return the whitening of a sensor's blocks that take part."""
        if sensor not in self.whitenings:
            rows = [self.valid(run, sensor) for run in range(len(self.runs))]
            self.whitenings[sensor] = RowWhitening.of_runs(self.runs, rows, self.noise[sensor])
        return self.whitenings[sensor]

    def whitened(self, values: FloatArray, run: int, sensor: Sensor, axis: int) -> FloatArray:
        """Return values (valid blocks, q) whitened."""
        return self.whitening(sensor).of_run(values, run, axis)

    def raw_columns(self, run: int, sensor: Sensor, axis: int) -> tuple[IntArray, FloatArray]:
        """Return the unknowns of one axis and their columns over all blocks, level first."""
        place, standing = self.standing(run, sensor, axis)
        index, columns = [place], [standing]
        for term in self.terms_of(sensor):
            part = self.columns(term.effect, run, sensor)
            columns.append(part[:, axis] if part.ndim == 3 else part)
            index.append(term.indices(run, axis, columns[-1].shape[1]))
        return np.concatenate(index), np.concatenate(columns, axis=1)

    def _terms(self) -> list[Term]:
        terms: list[Term] = []
        start = self.levels
        for sensor in self.sensors:
            for effect in self.effects[sensor]:
                if effect.coupled and any(t.effect == effect for t in terms):
                    continue
                sharing = tuple(s for s in self.sensors if effect in self.effects[s])
                columns = [self.columns(effect, run, sensor) for run in range(len(self.runs))]
                width = max(c.shape[-1] for c in columns)
                shape: tuple[int, ...] = (width,) if columns[0].ndim == 3 else (width, 3)
                if effect.per_run:
                    shape = (len(self.runs), *shape)
                terms.append(Term(effect, sharing if effect.coupled else (sensor,), start, shape))
                start = terms[-1].unknowns.stop
        return terms


@dataclass(frozen=True, eq=False)
class FreeTerm:
    """A term whose form is searched beside columns that stand: those are eliminated once.

    With FᵀF = L Lᵀ of the columns F that stand, columns X of the term leave
    χ² = χ²_F − |S^(−½) (Xᵀy − Aᵀb)|², where A = L⁻¹FᵀX, b = L⁻¹Fᵀy and S = XᵀX − AᵀA
    (variable projection: Golub and Pereyra, SIAM Journal on Numerical Analysis 10, 1973).
    """

    design: Design
    term: Term
    pieces: Mapping[tuple[int, Sensor, int], tuple[IntArray, FloatArray, FloatArray]]
    """Run, sensor and axis the term acts on → unknowns, whitened F and y."""
    size: int
    """Unknowns of the columns that stand."""
    known: Factor
    half: FloatArray
    """b."""
    chi_square: float
    """Of the columns that stand alone."""

    @classmethod
    def of(cls, design: Design, term: Term) -> FreeTerm:
        """Return the term of a design, with everything else eliminated."""
        others = design.with_effects(
            {
                sensor: tuple(e for e in listed if sensor not in term.sensors or e != term.effect)
                for sensor, listed in design.effects.items()
            }
        )
        equations = others.equations()
        known = factor(equations.gram)
        half = known.half(equations.moment)[:, 0]
        left = float(equations.energy[0] - half @ half)
        pieces = {key: others.piece(*key) for key in others.pieces() if key[1] in term.sensors}
        return cls(design, replace(term, start=0), pieces, others.size, known, half, left)

    def least_squares(self, effect: Effect) -> float:
        """Return the least whitened sum of squares with the term in the form of `effect`."""
        design, term = self.design, self.term
        size = int(np.prod(term.shape))
        gram, moment = np.zeros((size, size)), np.zeros(size)
        across = np.zeros((self.size, size))
        every: dict[tuple[int, Sensor], FloatArray] = {}
        for (run, sensor, axis), (index, standing, right) in self.pieces.items():
            if (run, sensor) not in every:
                columns = design.runs[run].columns(effect, sensor)
                every[run, sensor] = columns[design.valid(run, sensor)]
            columns = every[run, sensor]
            part = columns[:, axis] if columns.ndim == 3 else columns
            white = design.whitened(part, run, sensor, axis)
            place = term.indices(run, axis, white.shape[1])
            gram[np.ix_(place, place)] += white.T @ white
            moment[place] += white.T @ right[:, 0]
            across[np.ix_(index, place)] += standing.T @ white
        deviations = effect.coefficient_deviations()
        if deviations is not None:
            gram.flat[:: size + 1] += prior_precision(deviations).ravel()
        reduced = self.known.half(across)
        new = factor(gram - reduced.T @ reduced, np.diag(gram))
        new_half = new.half((moment - reduced.T @ self.half)[:, None])
        return max(self.chi_square - float((new_half**2).sum()), 0.0)
