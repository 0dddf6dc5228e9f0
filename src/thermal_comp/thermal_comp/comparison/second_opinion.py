# SPDX-License-Identifier: Apache-2.0
"""A second opinion on the curves an autopilot fits to one log: what they leave, there and later.

While the temperature only rises, every lag is a curve over temperature: the log cannot tell them
apart, and a cubic takes both. What it then leaves when the board cools is predicted with a lag, or
a hysteresis, beside the cubic. The lag's coefficient has, where nothing is measured, the prior of
a sensing element that follows the thermometer: as large as the slope over temperature; that of a
hysteresis is smaller. The time constant may be each of LAGS_S, the half-width each of
HALF_WIDTHS_K, or there is neither. Given noise that is known, the coefficients are normally
distributed for each of these, and they weigh by their evidence
(MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 28).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording
from numpy.typing import NDArray

from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.data.preparation import prepare_run
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.bias_temperature_curvature import BiasTemperatureCurvature
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.thermal_hysteresis import ThermalHysteresis
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.fitting.fit import fit_prepared, usable_sensors
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.linear.gaussian_evidence import log_sum
from thermal_comp.model.export.autopilot_fit import FITS, Autopilot, AutopilotFit
from thermal_comp.model.export.cubic import Cubic
from thermal_comp.model.values import ModelError
from thermal_comp.noise.of_runs import determined_noise

FITTED: tuple[Sensor, ...] = ('accelerometer', 'gyroscope')
"""Sensors that autopilots have curves of."""
POWERS = (BiasTemperature(), BiasTemperatureCurvature())
"""Effects that are a cubic together."""
FLAT_PRIOR_PRECISION = 1e-6
"""Precision of their coefficients before the log is seen, of whitened columns of unit length."""
LAGS_S = tuple(np.geomspace(15.0, 1200.0, 26).tolist())
"""Time constants a lag may have [s]: package to enclosure, close enough together that the one
between two of them is predicted as well."""
LAG_BELIEF = 0.5
"""Probability of a lag before the log is seen …"""
HALF_WIDTHS_K = tuple(np.geomspace(1.0, 10.0, 12).tolist())
"""Half-widths a hysteresis may have [K]."""
HYSTERESIS_BELIEF = 0.2
"""… of a hysteresis …"""
HYSTERESIS_SHARE = 0.2
"""… and how large its coefficient is, as a rule, in slopes: a lag's is as large as the slope."""
LEARNING_RATE = 0.1
"""Weight of the evidence between forms of which none is exact (Grünwald and van Ommen, Bayesian
Analysis 12(4), 2017): with 1 the prediction would be too sure (benchmarks/second_opinion.py)."""
DRAWS = 400
BAND = (2.5, 50.0, 97.5)
"""Percentiles of the prediction."""
SMOOTHED_S = 60.0
"""The direction of the temperature is that of means over this [s]."""
LEAST_CHANGE_K = 0.2
"""Change between them that is a direction [K]."""
TELLING_SHARE = 0.4
"""Share of the range passed both ways from which a log can tell a lag from a curve."""
LEAST_SPAN_K = 5.0
"""Range below which there is no curve to fit [K]."""


@dataclass(frozen=True, eq=False)
class SensorOpinion:
    """What a cubic is worth on one sensor; errors are rms of block means per axis, (3,) [unit]."""

    cubic: Cubic
    """What the autopilot's script fits to the whole log."""
    raw: FloatArray
    """Error about its mean before anything is subtracted."""
    held_out: FloatArray
    """What the cubic of the rest of the log leaves on each part, about the level of the rest and
    at temperatures that the rest has seen."""
    noise_floor: FloatArray
    """What noise alone leads to expect of it."""
    cooling: FloatArray
    """(3,) 2.5, 50 and 97.5 % of the rms over axes that the cubic will leave when the board cools
    as fast as it was warmed, about the level of the log [unit]."""


@dataclass(frozen=True, eq=False)
class SecondOpinion:
    """What can be said of the curves of one IMU from one log."""

    device: str
    autopilot: Autopilot
    temperature_range: tuple[float, float]
    """[°C]."""
    both_ways: float
    """Share of the range that was passed warming and cooling."""
    sensors: Mapping[Sensor, SensorOpinion]
    run: PreparedRun
    notes: Sequence[str] = ()
    """Which sensors nothing is said of, and why."""

    @property
    def decidable(self) -> bool:
        """Whether the log can tell a lag from a curve."""
        return self.both_ways >= TELLING_SHARE


def second_opinion(
    recording: ImuRecording, autopilot: Autopilot, *, seed: int = 0
) -> SecondOpinion:
    """Return what the autopilot's curves are worth; raises ModelError where there is no curve.

    `seed` draws the coefficients of which the prediction for cooling is made.
    """
    run = prepare_run(recording, 'log')
    low, high = float(run.temperature.min()), float(run.temperature.max())
    if not high - low >= LEAST_SPAN_K:
        raise ModelError(
            f'temperature: {low:.1f} … {high:.1f} °C is no range for a curve; warm the board by '
            f'{LEAST_SPAN_K:g} K at least, better by 30'
        )
    usable, left_out = usable_sensors([run])
    known = [s for s in usable if s in FITTED]
    if not known:
        raise ModelError('neither accelerometer nor gyroscope can be used: nothing to judge')
    cubic = compare_prepared(fit_prepared(dict.fromkeys(known, POWERS), [run]), [run])
    fit = FITS[autopilot]
    rng = np.random.default_rng(seed)
    sensors = {}
    for sensor in known:
        fitted = _fitted(fit, recording, sensor, np.ones(len(recording), bool))
        sensors[sensor] = SensorOpinion(
            fitted,
            cubic.sensors[sensor].measured_rms,
            _held_out(fit, recording, run, sensor),
            cubic.sensors[sensor].noise_floor,
            _when_cooling(run, sensor, fitted, rng),
        )
    notes = [note for note in left_out if note.startswith(FITTED)]
    span = (low, high)
    return SecondOpinion(recording.device, autopilot, span, _both_ways(run), sensors, run, notes)


def _fitted(
    fit: AutopilotFit, recording: ImuRecording, sensor: Sensor, rows: NDArray[np.bool_]
) -> Cubic:
    values = getattr(recording, SENSOR_FIELDS[sensor])
    good = rows & np.isfinite(recording.temperature) & np.isfinite(values).all(axis=1)
    return fit(recording.time[good], recording.temperature[good], values[good], sensor)


def _held_out(
    fit: AutopilotFit, recording: ImuRecording, run: PreparedRun, sensor: Sensor
) -> FloatArray:
    """(3,) rms that the cubic of the rest leaves on each part of the log."""
    measured = run.measured[sensor]
    edges = run.time - 0.5 * run.period
    block = np.clip(np.searchsorted(edges, recording.time, side='right') - 1, 0, len(run) - 1)
    part = run.cv_group[block]
    squares = []
    for held in range(1, int(run.cv_group.max()) + 1):
        cubic = _fitted(fit, recording, sensor, part != held)
        left = measured - cubic.error(run.temperature)
        seen = np.isfinite(left).all(axis=1)
        seen &= (run.temperature >= cubic.low) & (run.temperature <= cubic.high)
        inside = run.cv_group == held
        squares.append((left[inside & seen] - left[~inside & seen].mean(axis=0)) ** 2)
    return np.sqrt(np.concatenate(squares).mean(axis=0))


def _both_ways(run: PreparedRun) -> float:
    """Return the share of the temperature range that was passed warming and cooling."""
    place = (run.time // SMOOTHED_S).astype(int)
    count = np.bincount(place)
    means = np.bincount(place, run.temperature)[count > 0] / count[count > 0]
    turning, course = [], float(means[0])
    for value in means:  # the direction holds until it has changed by more than noise
        if abs(value - course) > LEAST_CHANGE_K:
            turning.append((course, float(value)))
            course = float(value)
    bins = np.arange(run.temperature.min(), run.temperature.max(), 1.0)
    if len(bins) == 0:
        return 0.0
    passed = np.zeros((2, len(bins)), bool)
    for start, stop in turning:
        low, high = min(start, stop), max(start, stop)
        passed[int(stop > start)] |= (bins + 1.0 > low) & (bins < high)
    return float(passed.all(axis=0).mean())


def _when_cooling(
    run: PreparedRun, sensor: Sensor, cubic: Cubic, rng: np.random.Generator
) -> FloatArray:
    """(3,) percentiles BAND of the rms over axes that a cubic leaves on the log's way back."""
    noise = determined_noise([run], {sensor: POWERS})[0][sensor]
    design = CandidateDesign(ColumnSource([run]), sensor, noise, [])
    course = _there_and_back(run.block_conditions.of(sensor))
    histories: list[tuple[Effect | None, float]] = [(None, 0.0)]
    histories += [(ThermalLag(seconds), 1.0) for seconds in LAGS_S]
    histories += [(ThermalHysteresis((r,)), HYSTERESIS_SHARE) for r in HALF_WIDTHS_K]
    alternatives = [_Alternative(design, effect, share, course) for effect, share in histories]
    belief = [
        1.0 - LAG_BELIEF - HYSTERESIS_BELIEF,
        *[LAG_BELIEF / len(LAGS_S)] * len(LAGS_S),
        *[HYSTERESIS_BELIEF / len(HALF_WIDTHS_K)] * len(HALF_WIDTHS_K),
    ]
    evidence = np.array([one.log_evidence for one in alternatives])
    weight = LEARNING_RATE * evidence + np.log(belief)
    chosen = rng.choice(len(histories), DRAWS, p=np.exp(weight - log_sum(weight)))
    subtracted, found = cubic.error(course.temperature), []
    for number in chosen:
        left = alternatives[number].drawn_error(rng) - subtracted
        level = left[: len(run)].mean(axis=0)
        found.append(np.sqrt(np.mean((left[len(run) :] - level) ** 2)))
    return np.asarray(np.percentile(found, BAND))


def _there_and_back(conditions: Conditions) -> Conditions:
    """Return the conditions of a run, then the same temperatures backwards."""
    rows = len(conditions)
    there = np.arange(rows)
    both = conditions.rows(np.concatenate([there, there[::-1]]))
    step = (conditions.time[-1] - conditions.time[0]) / max(rows - 1, 1)
    back = conditions.time[-1] + step + conditions.time[-1] - conditions.time[::-1]
    return replace(both, time=np.concatenate([conditions.time, back]))


class _Alternative:
    """A polynomial, with a lag, a hysteresis or without, fitted to the log: its evidence too."""

    def __init__(
        self, design: CandidateDesign, history: Effect | None, share: float, course: Conditions
    ) -> None:
        effects = POWERS if history is None else (*POWERS, history)
        columns = [c for effect in effects for c in design.term(effect).columns]
        size = np.concatenate([design.size_of(design.term(effect)) for effect in effects])
        size = np.maximum(size, 1e-300)
        self._columns = np.concatenate([e.columns(course)[0] for e in effects], axis=1) / size
        self._means, self._roots = np.zeros((3, len(columns))), []
        self.log_evidence = 0.0
        for axis, (normal, right) in enumerate(zip(*design.equations(columns), strict=True)):
            precision = np.full(len(columns), FLAT_PRIOR_PRECISION)
            if history is not None:
                slope = right[0] / normal[0, 0] / size[0]
                precision[-1] = 1.0 / max((share * slope * size[-1]) ** 2, 1e-12)
                self.log_evidence += 0.5 * float(np.log(precision[-1]))
            lower = np.linalg.cholesky(normal + np.diag(precision))
            half = np.linalg.solve(lower, right)
            self._means[axis] = np.linalg.solve(lower.T, half)
            self._roots.append(np.linalg.inv(lower).T)
            self.log_evidence += 0.5 * float(half @ half) - float(np.log(np.diag(lower)).sum())

    def drawn_error(self, rng: np.random.Generator) -> FloatArray:
        """Return the (n, 3) error over the course with coefficients drawn from their posterior."""
        drawn = [
            mean + root @ rng.standard_normal(len(mean))
            for mean, root in zip(self._means, self._roots, strict=True)
        ]
        return np.asarray(self._columns @ np.stack(drawn, axis=1))
