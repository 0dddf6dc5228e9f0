# SPDX-License-Identifier: Apache-2.0
"""A second opinion on the curves an autopilot fits to one log: their error there and in cooling.

While the temperature only rises, the error of a lag is a curve over temperature: the log cannot
tell them apart, and a cubic fits both. The error it then leaves when the board cools is predicted
with a lag, or a hysteresis, beside the cubic. The prior of the lag's coefficient is that of a
sensing element that follows the thermometer: as large as the slope over temperature; that of a
hysteresis is smaller. The time constant may be each of LAGS_S, the half-width each of
HALF_WIDTHS_K, or there is neither. For each of these the coefficients are normally distributed, as
the noise is known, and the forms are weighted by their evidence (MacKay, Information Theory,
Inference, and Learning Algorithms, 2003, ch. 28).

Parts of the log are held out here and not by `held_out`, as an autopilot's script fits samples,
not a design. Where there are several logs of a device, each curve is tried on the others: each
power-on has a level of its own, which no curve knows, so errors are about the level of the log
they are taken on.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording
from numpy.typing import NDArray

from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.conditions import INERTIAL_SENSORS, Conditions, Sensor
from thermal_comp.data.preparation import prepare_run
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.bias_temperature_curvature import BiasTemperatureCurvature
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.thermal_hysteresis import ThermalHysteresis
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.export.cubic import Cubic
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.inputs import usable_sensors
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.linear.gaussian_evidence import log_sum
from thermal_comp.model.values import ModelError
from thermal_comp.noise.of_runs import determined_noise
from thermal_comp.second_opinion.autopilot_fit import AUTOPILOT_FITS, Autopilot, AutopilotFit

CUBIC_EFFECTS = (BiasTemperature(), BiasTemperatureCurvature())
"""Effects that together are a cubic."""
FLAT_PRIOR_PRECISION = 1e-6
"""Precision of their coefficients before the log is seen, of whitened columns of unit length."""
LAGS_S = tuple(np.geomspace(15.0, 1200.0, 26).tolist())
"""Time constants a lag may have [s]: package to enclosure, close enough together for any between
them."""
HALF_WIDTHS_K = tuple(np.geomspace(1.0, 10.0, 12).tolist())
"""Half-widths a hysteresis may have [K]."""
LAG_PROBABILITY, HYSTERESIS_PROBABILITY = 0.5, 0.2
"""Probabilities of a lag and of a hysteresis before the log is seen."""
HYSTERESIS_SHARE = 0.2
"""Prior standard deviation of a hysteresis' coefficient over the slope: that of a lag is 1."""
LEARNING_RATE = 0.1
"""Weight of the evidence between forms of which none is exact (Grünwald and van Ommen, Bayesian
Analysis 12(4), 2017): with 1 the prediction would be too sure (benchmarks/second_opinion.py)."""
PREDICTION_DRAWS = 400
"""Draws of form and coefficients that the prediction is made of."""
PERCENTILES = (2.5, 50.0, 97.5)
"""Percentiles by which the prediction is given."""
DIRECTION_MEAN_S = 60.0
"""Length of the means that tell the direction of the temperature [s]."""
LEAST_DIRECTION_CHANGE_K = 0.2
"""Change between them from which the temperature has a direction [K]."""
LEAST_TWO_WAY_SHARE = 0.4
"""Share of the range passed warming and cooling from which a log can tell a lag from a curve."""
LEAST_SPAN_K = 5.0
"""Range of temperature that a curve needs [K]."""
LEAST_COMMON_K = 3.0
"""Range of temperature that two logs have to share [K]."""


@dataclass(frozen=True, eq=False)
class SensorOpinion:
    """The errors of a cubic on one sensor, rms of block means per axis, (3,) [unit]."""

    cubic: Cubic
    """What the autopilot's script fits to the whole log."""
    raw: FloatArray
    """Error about its mean before anything is subtracted."""
    held_out: FloatArray
    """Error of the cubic of the rest of the log on each part, about the level of the rest and at
    temperatures in the rest."""
    noise_floor: FloatArray
    """The same to expect of noise alone."""
    cooling: FloatArray
    """(3,) 2.5, 50 and 97.5 % of the rms over axes that the cubic will leave when the board cools
    as fast as it was warmed, about the level of the log [unit]."""


@dataclass(frozen=True, eq=False)
class SecondOpinion:
    """The second opinion on the curves of one IMU, from one log."""

    device: str
    autopilot: Autopilot
    temperature_range: tuple[float, float]
    """[°C]."""
    both_ways: float
    """Share of the range that was passed warming and cooling."""
    sensors: Mapping[Sensor, SensorOpinion]
    run: PreparedRun
    notes: Sequence[str] = ()
    """Which sensors are left out, and why."""

    @property
    def decidable(self) -> bool:
        """Whether the log can tell a lag from a curve."""
        return self.both_ways >= LEAST_TWO_WAY_SHARE


@dataclass(frozen=True, eq=False)
class OtherLogs:
    """Errors of the curves of a sensor on other logs than their own, rms per axis, (3,) [unit]."""

    pairs: int
    """Number of curves times the other logs that share temperatures with each."""
    raw: FloatArray
    """Before anything is subtracted."""
    left: FloatArray
    """With the curve of another log."""
    own: FloatArray
    """With the curve of the rest of the same log, held out."""


def second_opinion(
    recording: ImuRecording, autopilot: Autopilot, *, seed: int = 0
) -> SecondOpinion:
    """Return the opinion on the autopilot's curves; raises ModelError where there can be none.

    `seed` is that of the draws for the prediction of cooling.
    """
    run = prepare_run(recording, 'log')
    low, high = float(run.temperature.min()), float(run.temperature.max())
    if not high - low >= LEAST_SPAN_K:
        raise ModelError(
            f'temperature: {low:.1f} … {high:.1f} °C is no range for a curve; warm the board by '
            f'{LEAST_SPAN_K:g} K at least, better by 30'
        )
    usable, left_out = usable_sensors([run])
    known = [s for s in usable if s in INERTIAL_SENSORS]  # an autopilot fits curves to no other
    if not known:
        raise ModelError('neither accelerometer nor gyroscope can be used: nothing to judge')
    cubic = compare_prepared(fit_prepared(dict.fromkeys(known, CUBIC_EFFECTS), [run]), [run])
    fit = AUTOPILOT_FITS[autopilot]
    rng = np.random.default_rng(seed)
    sensors = {}
    for sensor in known:
        fitted = _fitted(fit, recording, sensor, np.ones(len(recording), bool))
        sensors[sensor] = SensorOpinion(
            cubic=fitted,
            raw=cubic.sensors[sensor].measured_rms,
            held_out=_held_out(fit, recording, run, sensor),
            noise_floor=cubic.sensors[sensor].noise_floor,
            cooling=_when_cooling(run, sensor, fitted, rng),
        )
    notes = [note for note in left_out if note.startswith(INERTIAL_SENSORS)]
    return SecondOpinion(
        device=recording.device,
        autopilot=autopilot,
        temperature_range=(low, high),
        both_ways=_both_ways(run),
        sensors=sensors,
        run=run,
        notes=notes,
    )


def on_other_logs(opinions: Sequence[SecondOpinion]) -> Mapping[Sensor, OtherLogs]:
    """Return the errors of the curves of a device on its other logs, by sensor."""
    found = {}
    for sensor in INERTIAL_SENSORS:
        known = [opinion for opinion in opinions if sensor in opinion.sensors]
        errors = [
            squares
            for one, other in itertools.permutations(known, 2)
            if (squares := _squares(one, other, sensor)) is not None
        ]
        if errors:
            raw, left = (np.concatenate(part) for part in zip(*errors, strict=True))
            own = np.stack([opinion.sensors[sensor].held_out for opinion in known])
            found[sensor] = OtherLogs(
                pairs=len(errors),
                raw=np.sqrt(raw.mean(axis=0)),
                left=np.sqrt(left.mean(axis=0)),
                own=np.sqrt((own**2).mean(axis=0)),
            )
    return found


def _squares(
    one: SecondOpinion, other: SecondOpinion, sensor: Sensor
) -> tuple[FloatArray, FloatArray] | None:
    """Return (m, 3) squared errors of the blocks of `other`, raw and with the curve of `one`."""
    left, seen = _left(one.sensors[sensor].cubic, other.run, sensor)
    if not seen.any() or np.ptp(other.run.temperature[seen]) < LEAST_COMMON_K:
        return None
    before, after = other.run.measured[sensor][seen], left[seen]
    return (before - before.mean(axis=0)) ** 2, (after - after.mean(axis=0)) ** 2


def _left(cubic: Cubic, run: PreparedRun, sensor: Sensor) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return (m, 3) block means minus a curve, and (m,) where it was fitted to the temperature."""
    left = run.measured[sensor] - cubic.error(run.temperature)
    seen = np.isfinite(left).all(axis=1)
    return left, seen & (run.temperature >= cubic.low) & (run.temperature <= cubic.high)


def _fitted(
    fit: AutopilotFit, recording: ImuRecording, sensor: Sensor, rows: NDArray[np.bool_]
) -> Cubic:
    """Return the autopilot's curve of some rows, without those that have no value."""
    values = getattr(recording, SENSOR_FIELDS[sensor])
    good = rows & np.isfinite(recording.temperature) & np.isfinite(values).all(axis=1)
    return fit(recording.time[good], recording.temperature[good], values[good], sensor)


def _held_out(
    fit: AutopilotFit, recording: ImuRecording, run: PreparedRun, sensor: Sensor
) -> FloatArray:
    """Return (3,) rms that the cubic of the rest leaves on each part of the log.

    An autopilot's script fits rows by rules of its own, not columns by least squares: sums over
    parts (`fitting.part_sums`) do not hold what it needs.
    """
    edges = run.time - 0.5 * run.period
    block = np.clip(np.searchsorted(edges, recording.time, side='right') - 1, 0, len(run) - 1)
    part = run.cv_group[block]
    squares = []
    for held in range(1, int(run.cv_group.max()) + 1):
        cubic = _fitted(fit, recording, sensor, part != held)
        left, seen = _left(cubic, run, sensor)
        inside = run.cv_group == held
        squares.append((left[inside & seen] - left[~inside & seen].mean(axis=0)) ** 2)
    return np.sqrt(np.concatenate(squares).mean(axis=0))


def _both_ways(run: PreparedRun) -> float:
    """Return the share of the temperature range that was passed warming and cooling."""
    place = (run.time // DIRECTION_MEAN_S).astype(int)
    count = np.bincount(place)
    means = np.bincount(place, run.temperature)[count > 0] / count[count > 0]
    turning, course = [], float(means[0])
    for value in means:  # the direction holds until it has changed by more than noise
        if abs(value - course) > LEAST_DIRECTION_CHANGE_K:
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
    """Return (3,) PERCENTILES of the rms over axes that a cubic leaves on the log's way back."""
    noise = determined_noise([run], {sensor: CUBIC_EFFECTS})[0][sensor]
    design = CandidateDesign(ColumnSource([run]), sensor, noise, [])
    course = _there_and_back(run.block_conditions.of(sensor))
    histories: list[tuple[Effect | None, float]] = [(None, 0.0)]
    histories += [(ThermalLag(seconds), 1.0) for seconds in LAGS_S]
    histories += [(ThermalHysteresis((r,)), HYSTERESIS_SHARE) for r in HALF_WIDTHS_K]
    alternatives = [_Alternative(design, effect, share, course) for effect, share in histories]
    probability = [
        1.0 - LAG_PROBABILITY - HYSTERESIS_PROBABILITY,
        *[LAG_PROBABILITY / len(LAGS_S)] * len(LAGS_S),
        *[HYSTERESIS_PROBABILITY / len(HALF_WIDTHS_K)] * len(HALF_WIDTHS_K),
    ]
    evidence = np.array([one.log_evidence for one in alternatives])
    weight = LEARNING_RATE * evidence + np.log(probability)
    chosen = rng.choice(len(histories), PREDICTION_DRAWS, p=np.exp(weight - log_sum(weight)))
    subtracted, found = cubic.error(course.temperature), []
    for number in chosen:
        left = alternatives[number].drawn_error(rng) - subtracted
        level = left[: len(run)].mean(axis=0)
        found.append(np.sqrt(np.mean((left[len(run) :] - level) ** 2)))
    return np.asarray(np.percentile(found, PERCENTILES))


def _there_and_back(conditions: Conditions) -> Conditions:
    """Return the conditions of a run, then the same temperatures backwards."""
    rows = len(conditions)
    there = np.arange(rows)
    both = conditions.rows(np.concatenate([there, there[::-1]]))
    step = (conditions.time[-1] - conditions.time[0]) / max(rows - 1, 1)
    back = conditions.time[-1] + step + conditions.time[-1] - conditions.time[::-1]
    return replace(both, time=np.concatenate([conditions.time, back]))


class _Alternative:
    """A polynomial, with a lag, a hysteresis or neither, fitted to the log, and its evidence."""

    def __init__(
        self, design: CandidateDesign, history: Effect | None, share: float, course: Conditions
    ) -> None:
        effects = CUBIC_EFFECTS if history is None else (*CUBIC_EFFECTS, history)
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
