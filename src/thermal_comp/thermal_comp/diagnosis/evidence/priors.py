# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis believes before it has seen the recordings: every number with its reason.

Amplitudes are counted in the norm of the whitened rows they explain, √Δχ²: the error in units of
its own noise, times the root of the number of independent rows. It needs no unit and no sensor.
"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray
from scipy.special import log_ndtr, ndtr

NOTHING_PROBABILITY = 0.75
"""That a sensor's model lacks nothing: most effects are felt by one sensor of three, and in a
campaign of four there is none."""

ANOTHER_EFFECT_PROBABILITY = 0.15
"""That a sensor with some effects has another one: most campaigns have a single one, and of two
effects many are felt by different sensors."""

NOT_IN_CATALOGUE_PROBABILITY = 0.15
"""That what a sensor lacks is not in the catalogue: packaged MEMS are old, boards are not."""

UNLOGGED_PROBABILITY = 0.15
"""That it follows a variable that was not logged, where a variable is missing."""

LOOKS_LIKE_LOST_PROBABILITY = 0.85
"""That an effect found beside such a variable is a part of what the variable does, where its
traces, or a guess, follow it in part only: some effect always looks most like what is left …"""
LOOKS_LIKE_LOST_LN = 0.8
"""… and standard deviation of ln of its ratio to what they follow: it is about as large."""

GUESSED_COURSE_PROBABILITY = 0.5
"""That such a variable has the course that is guessed: that of closed air, or of what a die that
heats itself follows; doors are opened, and fans turned."""

WITHOUT_TRACE_PROBABILITY = 0.5
"""That such a variable leaves no trace in those that were logged, only a course over time."""

JUMPS_BY_ITSELF_PROBABILITY = 0.5
"""That what is not in the catalogue jumps between levels, where a bias does: telegraph noise of a
contact or a trap, a part that sticks and slips."""

UNSEEN_TWIN_ODDS = 0.5
"""Odds that an effect whose channel was not logged acts in place of the one it looks like: all
effects are equally likely, but in half of all recordings its exact course would differ."""

ANY_CAUSE_ODDS = 0.25
"""Odds that another cause acts in place of an effect whose form any cause may have: most steady
oscillations near a sensor that is sampled slowly are the mains."""

TWIN_SHARE, TWIN_SHARE_LN = 0.05, 0.8
"""Median and standard deviation of ln of how much columns of twins may differ without telling
which acts: a derivative, and a thermometer beside the die, are right to some per cent."""

AMPLITUDES: FloatArray = np.geomspace(1.0, 4096.0, 13)
"""Standard deviations of an amplitude [√Δχ²], all equally likely: from what no test would find to
a thousand times that; effects of the field's literature span three decades."""

AMPLITUDE_RATIO_LN = 1.5
"""Standard deviation of ln of the ratio of two effects on one sensor: 1:4 is usual, 1:20 rare."""

UNNAMED_RATIO_LN = 1.2
"""The same for what has no name beside effects that have one: small things are their flaws."""

FORM_APPROXIMATE_PROBABILITY = 0.5
"""That an effect's equation is only nearly right: it is a first-order law of a solid body."""

FORM_SHARE, FORM_SHARE_LN = 0.06, 1.2
"""Median and standard deviation of ln of the amplitude of what equations lack, as a share of all
they explain: laws of this kind are right to some per cent, seldom to a fifth."""
LARGEST_FLAW_SHARE = 0.5
"""Share beyond which it is no flaw: what is mostly something else has another cause."""
LIKENESS_SHARE, LIKENESS_SHARE_LN = 0.03, 0.8
"""The same where it looks like another effect: what is a tenth or more is that effect."""

SECOND_PARTS = tuple((share, ratio) for share in (0.15, 0.3) for ratio in (1.0 / 3.0, 3.0))
"""Share of a second part of what relaxes with one time constant, and how many times as long its
time constants are: package, die and board are bodies of their own. All equally likely."""

CHANNEL_FLAWED_PROBABILITY = 0.3
"""That what an effect lacks is an error of the channel that it follows, noise or another place, or
of the amplitude of its line, which comes and goes with its cause."""

SLOW_NOISE_RATIOS = ((0.0, 0.0, 0.5), (3.0, 0.0, 0.3), (15.0, 0.0, 0.1), (15.0, 2.0, 0.1))
"""Slow noise beyond the fitted one: ratio r of variances and power p, in the n-th slowest
direction r n^−p, with probabilities. What a few periods tell of a variance is right to a factor of
two to four; of the slowest, which a saturated model follows, nothing is told: a bias may walk at
random (IEEE 952) by more than faster noise lets expect."""
SLOW_NOISE_SHARE = 0.025
"""Share of the longest run from which a time constant of the noise is slow."""

THERMOMETER_LAGS_S = ((8.0, 0.8), (60.0, 0.2))
"""Standard deviations of the thermometer's own lag [s] with probabilities: one on the die lags by
package and filter, one beside it by the board between."""
THERMOMETER_AIR_S = 300.0
"""Time constant of die against air [s]: what lags by a time less reads that share of the air."""
THERMOMETER_BOARD_S = 10.0
"""That of die against board [s]: what lags by more is as far from the die as the board."""
THERMOMETER_HYSTERESIS_K = (0.05, 0.1)
"""Half-widths of plays that its hysteresis consists of [K]: an LSM9DS1's has counts of 1/16 K …"""
THERMOMETER_DIES_S = tuple(np.geomspace(20.0, 2000.0, 21).tolist())
"""… and time constants of dies that move with the air meanwhile: bare boards, housings [s]."""
THERMOMETER_PARTS_S = (30.0, 100.0, 300.0, 1000.0)
"""Time constants of what it follows beside the die: package, board, housing [s] …"""
THERMOMETER_PART_SHARE = 0.3
"""… and standard deviation of each one's share of its lag."""
OTHER_THERMOMETERS_STD = 1.0
"""Standard deviation of how much of the difference is the die's, where other thermometers let one
expect another temperature than its own says, which may be coarse, or noisy and smoothed [K/K]."""
SLOPE_CHANGE_STD = 0.3
"""Standard deviation of the change of a slope over the temperatures of a run, of itself."""
THERMOMETER_SETTLING_S = (40.0, 120.0, 360.0)
"""Times over which it settles after power-on [s] …"""
THERMOMETER_TRANSIENT_K = 0.5
"""… and standard deviation of what it is off by at first [K]: self-heating of 0.3 to 1 K."""
THERMOMETER_FLAWS = ((0.1, 0.5), (0.3, 0.3), (1.0, 0.2))
"""Share of the thermometer's errors to which other sensors tell them, with probabilities: a lag
has no exact form, and an effect of theirs that looks like one is told as one."""

SHAPE_STEP_LN = 0.3
"""Distance of neighbouring forms on a search grid, in ln of the shape parameter."""


def thermometer_deviations(lag: float, columns: int) -> FloatArray:
    """Return (columns,) standard deviations of the first of the thermometer's errors.

    They are lag [s], its square [s²], what it follows slowly [K/K], plays of its hysteresis
    [K/K], the widest about a die that follows the air [K/K], transients [K], and for each run
    the shares of air and board and of a die that follows them [K/K].
    """
    plays = [1.0] * (len(THERMOMETER_HYSTERESIS_K) + 1)
    parts = [THERMOMETER_PART_SHARE * lag / seconds for seconds in THERMOMETER_PARTS_S]
    transients = [THERMOMETER_TRANSIENT_K] * len(THERMOMETER_SETTLING_S)
    shares = [lag / THERMOMETER_AIR_S, min(lag / THERMOMETER_BOARD_S, 1.0), OTHER_THERMOMETERS_STD]
    return np.array([lag, lag**2, *parts, *plays, *transients, *(columns * shares)])[:columns]


def amplitude_log_prior(strongest: float | None, spread: float = AMPLITUDE_RATIO_LN) -> FloatArray:
    """Return (s,) ln of the prior over AMPLITUDES of an effect beside one of √Δχ² `strongest`."""
    if strongest is None:
        return np.full(len(AMPLITUDES), -np.log(len(AMPLITUDES)))
    return _log_normal(AMPLITUDES / max(strongest, 1.0), 1.0, spread)


def flaw_log_prior(
    explained: float, share: float = FORM_SHARE, spread: float = FORM_SHARE_LN
) -> FloatArray:
    """Return (s,) ln of the prior over AMPLITUDES of what equations lack that explain √Δχ².

    What is smaller than the grid's first explains nothing, as that one.
    """
    ratio = AMPLITUDES / max(explained, 1.0)
    edges = np.log(np.sqrt(ratio[1:] * ratio[:-1]) / share) / spread
    below = np.concatenate([[0.0], ndtr(edges), [1.0]])
    return np.asarray(np.log(np.maximum(np.diff(below), 1e-300)))


def log_odds_of_twin(share: float, lagging: float = 0.0) -> float:
    """Return ln of the odds that the flaws of two twins make up what one explains better.

    `share` is √Δχ² by which it is better over √Δχ² that is explained; `lagging` is the share by
    which a column changes where the thermometer lags.
    """
    median = float(np.hypot(TWIN_SHARE, lagging))
    return float(log_ndtr(-np.log(max(share, 1e-9) / median) / TWIN_SHARE_LN))


def probability_of_lost(ratio: float) -> float:
    """Return the probability that an effect is a part of what a lost channel does.

    `ratio` is √Δχ² of the effect over that of what traces of the channel follow.
    """
    odds = LOOKS_LIKE_LOST_PROBABILITY / (1.0 - LOOKS_LIKE_LOST_PROBABILITY)
    away = float(np.log(max(ratio, 1e-9)))
    density = (away / LOOKS_LIKE_LOST_LN) ** 2 - (away / AMPLITUDE_RATIO_LN) ** 2
    odds *= AMPLITUDE_RATIO_LN / LOOKS_LIKE_LOST_LN * float(np.exp(-0.5 * density))
    return odds / (1.0 + odds)


def unnamed_over_time() -> tuple[float, float]:
    """Return the probabilities of a law without a name and of a lost channel without a trace."""
    return NOT_IN_CATALOGUE_PROBABILITY, UNLOGGED_PROBABILITY * WITHOUT_TRACE_PROBABILITY


def log_odds_of_cause_of_noise(loudness: float, *, beside: bool = False) -> float:
    """Return ln of the odds that noise which is louder than usual has a cause without a name.

    `loudness` is ln of the prior of such noise relative to usual noise, a normal density of the
    ln of its ratio with standard deviation 1; the cause is of any size on the grid. `beside`: it
    stands beside an effect that has a name.
    """
    any_effect = (1.0 - NOTHING_PROBABILITY) / NOTHING_PROBABILITY
    once = sum(unnamed_over_time()) * (ANOTHER_EFFECT_PROBABILITY if beside else any_effect)
    size = 1.0 / np.log(AMPLITUDES[-1] / AMPLITUDES[0])
    return float(np.log(once * size) - loudness + 0.5 * np.log(2.0 * np.pi))


def _log_normal(ratio: FloatArray, median: float, spread: float) -> FloatArray:
    """Density of ln ratio times the grid's distance; what lies below the grid has no effect."""
    step = float(np.log(AMPLITUDES[1] / AMPLITUDES[0]))
    away = (np.log(ratio) - np.log(median)) / spread
    density: FloatArray = -0.5 * away**2 - np.log(spread * np.sqrt(2.0 * np.pi)) + np.log(step)
    return density
