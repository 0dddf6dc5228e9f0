# SPDX-License-Identifier: Apache-2.0
"""What every hypothesis allows for: slow noise beyond the fitted one, errors of thermometers.

And what rounding of the sensor's own counts and readings that were held leave, and coefficients of
the base model that the axes share.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import TypeAlias

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.data.kept_results import kept
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.smoothing import errors_between_counts
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.rounding_errors import rounding_errors
from thermal_comp.diagnosis.evidence.temperature_course import (
    TemperatureSlope,
    temperature_history,
)
from thermal_comp.effects.operators import follow, play
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup
from thermal_comp.linear.columns import LEAST_NEW_LENGTH
from thermal_comp.linear.gaussian_evidence import CoefficientPrior

Response: TypeAlias = Callable[[PreparedRun, FloatArray], FloatArray]
"""What errors (n, q) of the temperature [K] do to the block means of a run, (m, 3, q) [unit]."""
DIRECTIONS, DIRECTIONS_OF_ALL = 8, 24
"""Least number of the strongest directions of slow noise: per run, and over all runs together.

With time constants from a share s of a run of length T on, slow noise has a band of 1/(2π s T), in
which 2 T / (2π s T) = 1/(π s) ≈ 12 directions are independent; s is priors.SLOW_NOISE_SHARE. Two
fifths of what such noise has beyond its corner lie below twice the band: 24. The variance of slow
noise is estimated from them alone in a single run, from all runs in several."""
FREE_DEVIATION = 1e5
"""Deviation of a coefficient that may have any value, of a column of unit length."""
COVARIANCE_INSTANTS = 160
"""Instants at which their covariance is computed; they are smooth between."""


def nuisance_priors(
    design: CandidateDesign, thermometer: ColumnGroup, response: Response | None = None
) -> list[tuple[float, list[CoefficientPrior]]]:
    """Return what is allowed for beside any hypothesis, in alternatives with ln probabilities.

    The first of each is the thermometer's errors.
    """
    always = [*_between_counts(design, response), *rounding_errors(design), *_of_base(design)]
    slow = design.generic_terms([(partial(_slow_directions, design), True)])[0]
    size = design.size_of(slow)
    alternatives = []
    place = 1.0 + np.arange(len(size)) % _directions_per_run(design)  # slowest of a run first
    for (excess, power, noisy), (seconds, slack) in product(
        priors.SLOW_NOISE_RATIOS, priors.THERMOMETER_LAGS_S
    ):
        deviation = priors.thermometer_deviations(seconds, len(thermometer.columns))
        deviation = deviation * design.size_of(thermometer)
        allowed = [CoefficientPrior(thermometer.columns, shared=True, deviation=deviation)]
        allowed += always
        if excess > 0.0:
            deviation = np.sqrt(excess * place**-power) * size
            allowed.append(CoefficientPrior(slow.columns, shared=False, deviation=deviation))
        alternatives.append((float(np.log(noisy * slack)), allowed))
    return alternatives


def _between_counts(design: CandidateDesign, response: Response | None) -> list[CoefficientPrior]:
    """Return what a coarse thermometer does not say between its counts; [] for a fine one."""
    response = response or TemperatureSlope.of(design).response
    runs = design.source.runs

    def errors(run: PreparedRun) -> FloatArray:
        between = errors_between_counts(run.conditions)
        return response(run, between) if between.size else np.zeros((len(run), 3, 0))

    term = design.generic_terms([(errors, True)], runs=runs)[0]
    if not term.columns:
        return []
    return [CoefficientPrior(term.columns, shared=True, deviation=design.size_of(term))]


def _of_base(design: CandidateDesign) -> list[CoefficientPrior]:
    """Return the coefficients of the base model that the axes share, all equally likely."""
    term = design.shared_base
    if not term.columns:
        return []
    return [CoefficientPrior(term.columns, True, np.full(len(term.columns), FREE_DEVIATION))]


def _directions_per_run(design: CandidateDesign) -> int:
    return max(DIRECTIONS, DIRECTIONS_OF_ALL // len(design.source.runs))


def _slow_directions(design: CandidateDesign, run: PreparedRun) -> FloatArray:
    """(m, 3, q) strongest directions of the slow part of the fitted noise, unit variance each.

    The slowest comes first.
    """
    noise = design.noise.of_run(run.name)
    longest = max(float(some.time[-1]) for some in design.source.runs)
    slow = noise.time_constants >= longest * priors.SLOW_NOISE_SHARE
    support = np.linspace(run.time[0], run.time[-1], min(len(run.time), COVARIANCE_INSTANTS))
    apart = np.abs(support[:, None] - support)
    each = np.exp(-apart[None] / noise.time_constants[slow][:, None, None])
    count = _directions_per_run(design)
    columns = np.empty((len(run.time), 3, count))
    for axis in range(3):
        covariance = np.tensordot(noise.amplitudes[slow, axis] ** 2, each, axes=1)
        values, vectors = np.linalg.eigh(covariance)
        strongest = np.argsort(values)[::-1][:count]
        for place, index in enumerate(strongest):
            shape = np.interp(run.time, support, vectors[:, index])
            columns[:, axis, place] = shape * np.sqrt(max(float(values[index]), 0.0))
    return columns


def errors_by_slope(design: CandidateDesign, response: Response) -> dict[str, FloatArray]:
    """Return by run (m, 3, q) what the errors of the die thermometer do; axes share coefficients.

    They are its lag (first and second order), slow nodes, hysteresis of the reading and of a die
    in the air, transients after power-on, and of each run alone shares of the temperatures of air
    and board and of a die that follows them: their thermometers are fixed anew where a device is
    turned. Priors: priors.thermometer_deviations(). `response` says what an error does.
    """
    runs = design.source.smoothed
    return {
        run.name: response(run, errors)
        for run, errors in zip(runs, _possible_errors(runs), strict=True)
    }


@kept
def _possible_errors(runs: Sequence[PreparedRun]) -> list[FloatArray]:
    """Return by run the (n, q) errors of the thermometer, one of each kind."""
    found = []
    for run in runs:
        conditions = run.conditions
        parts = [temperature_history(run), _hysteresis(conditions), _settling(conditions)]
        others = _by_other_thermometers(conditions)
        parts += [others if other is run else np.zeros_like(others) for other in runs]
        found.append(np.concatenate(parts, axis=1))
    return found


def _settling(conditions: Conditions) -> FloatArray:
    """(n, q) transients after power-on."""
    since = conditions.time - conditions.time[0]
    return np.asarray(np.exp(-since[:, None] / np.array(priors.THERMOMETER_SETTLING_S)))


def _hysteresis(conditions: Conditions) -> FloatArray:
    """(n, q) plays about the reading, one about a die in the air [K].

    Plays of several widths together are any hysteresis (Prandtl–Ishlinskii). That about a die in
    the air counts in dwells: the die follows the swings of the air's control, which are smaller
    than the hysteresis of the thermometer. Without the air's temperature it is zero.
    """
    temperature, air = conditions.temperature, conditions.chamber_temperature
    widths = priors.THERMOMETER_HYSTERESIS_K
    behind = [play(temperature, width)[0] - temperature for width in widths]
    unseen = np.zeros_like(temperature)
    if air is not None:
        die = _die_in(air, conditions)
        unseen = play(die, max(widths))[0] - die
    return np.stack([*behind, unseen], axis=1)


def _by_other_thermometers(conditions: Conditions) -> FloatArray:
    """(n, 3) temperatures of air, board, and a die that follows them, less the reading [K].

    Where the air's temperature was not logged it is guessed from the humidity; of what is not
    known at all the difference is zero.
    """
    temperature, air = conditions.temperature, conditions.chamber_temperature
    air = _air_by_humidity(conditions) if air is None else air
    board = conditions.device_temperature
    board = temperature if board is None else board
    die = _die_by_other_thermometers(conditions)
    return np.stack([air - temperature, board - temperature, die - temperature], axis=1)


def _die_by_other_thermometers(conditions: Conditions) -> FloatArray:
    """(n,) temperature of a die that follows air and board as the reading does [°C].

    What it is beyond the reading is what the reading does not say, as between the counts of a
    coarse thermometer, or what smoothing takes out of a noisy one. It warms itself after power-on.
    The reading itself where no other thermometer was logged.
    """
    others = [conditions.chamber_temperature, conditions.device_temperature]
    logged = [other for other in others if other is not None]
    if not logged:
        return conditions.temperature
    lags = priors.THERMOMETER_PARTS_S
    dies = [follow(conditions.time, other, lag)[0] for other in logged for lag in lags]
    columns = np.column_stack([np.ones_like(dies[0]), *dies, _settling(conditions)])
    told = np.linalg.lstsq(columns, conditions.temperature, rcond=LEAST_NEW_LENGTH)[0]
    return np.asarray(columns @ told)


def _air_by_humidity(conditions: Conditions) -> FloatArray:
    """(n,) temperature of the air by its humidity [°C]; the reading where that was not logged.

    Air that holds its water has a relative humidity whose logarithm falls with temperature.
    """
    temperature, humidity = conditions.temperature, conditions.humidity
    if humidity is None:
        return temperature
    columns = np.stack([np.ones_like(humidity), np.log(np.maximum(humidity, 0.01))], axis=1)
    return np.asarray(columns @ np.linalg.lstsq(columns, temperature, rcond=LEAST_NEW_LENGTH)[0])


def _die_in(air: FloatArray, conditions: Conditions) -> FloatArray:
    """(n,) temperature of a die that follows the air and warms itself after power-on.

    It has the lag that is most like the reading, and settles as that does: on which side of its
    hysteresis the thermometer stands before the first ramp is told by nothing else.
    """
    temperature = conditions.temperature - conditions.temperature.mean()
    dies = [follow(conditions.time, air, seconds)[0] for seconds in priors.THERMOMETER_DIES_S]
    likeness = [temperature @ (die - die.mean()) / max(float(die.std()), 1e-9) for die in dies]
    die = dies[int(np.argmax(likeness))]
    settling = _settling(conditions)
    columns = np.column_stack([np.ones_like(die), settling])
    warmth = np.linalg.lstsq(columns, conditions.temperature - die, rcond=LEAST_NEW_LENGTH)[0]
    return np.asarray(die + settling @ warmth[1:])
