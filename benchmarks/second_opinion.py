# SPDX-License-Identifier: Apache-2.0
"""How often a second opinion is right: python benchmarks/second_opinion.py [--logs N] [--seed S].

Boards of this file's own warm up (a line, an exponential, in steps, with draughts), with a lag, a
hysteresis or a curve hidden in the accelerometer, on one way only or there and back. Claims: of
one warm-up it says in at least 95 % that lag and curve cannot be told apart, whichever is hidden;
of a log there and back that they can; and what cooling then leaves is below the upper end of what
was predicted in at least 90 %. Exit code 1 where a claim fails.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.second_opinion.opinion import second_opinion
from verdict import Verdict, judge

from imu_recording import ImuRecording

RATE_HZ = 5.0
TELLS, HOLDS = 0.95, 0.90
HIDDEN = ('curve', 'lag', 'hysteresis')


@dataclass(frozen=True)
class Board:
    """A course of temperature there and back, and the error that goes with it."""

    temperature: FloatArray
    error: FloatArray
    half: int
    """Rows of the way there."""


def draw_board(rng: np.random.Generator, hidden: str) -> Board:
    seconds = rng.uniform(900.0, 3600.0)
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ) / seconds
    form = rng.choice(['line', 'exponential', 'steps'])
    rise = {
        'line': t,
        'exponential': (1.0 - np.exp(-3.0 * t)) / (1.0 - np.exp(-3.0)),
        'steps': (np.floor(6.0 * t) + np.minimum(6.0 * t % 1.0 * 3.0, 1.0)) / 6.0,
    }[str(form)]
    there = rng.uniform(-10.0, 25.0) + rng.uniform(15.0, 45.0) * rise
    course = np.concatenate([there, there[::-1]])
    draught = np.cumsum(rng.normal(0.0, 1.0, len(course)))
    draught -= np.linspace(draught[0], draught[-1], len(course))
    temperature = course + rng.uniform(0.0, 0.3) * draught / max(np.abs(draught).max(), 1e-9)
    slope = rng.uniform(1e-3, 6e-3, 3) * rng.choice([-1.0, 1.0], 3)
    if hidden == 'lag':
        share = 1.0 / (RATE_HZ * np.exp(rng.uniform(*np.log([20.0, 600.0]))))
        element, followed = temperature[0], np.empty_like(temperature)
        for k, value in enumerate(temperature.tolist()):
            element += (value - element) * share
            followed[k] = element
        error = np.outer(followed, slope)
    elif hidden == 'hysteresis':
        width, branch = rng.uniform(1.0, 8.0), temperature[0]
        held = np.empty_like(temperature)
        for k, value in enumerate(temperature.tolist()):
            branch = min(max(branch, value - width), value + width)
            held[k] = branch
        error = np.outer(temperature + rng.uniform(0.05, 0.3) * (held - temperature), slope)
    else:
        x = temperature - temperature.mean()
        error = np.outer(temperature + rng.uniform(0.003, 0.03) * x**2, slope)
    return Board(temperature, error, len(there))


def recorded(board: Board, rows: int, rng: np.random.Generator) -> ImuRecording:
    shape = (rows, 3)
    force = board.error[:rows] + [0.3, -0.2, 9.81] + rng.normal(0.0, 2e-3, shape)
    return ImuRecording(
        stamp=np.round(np.arange(rows) / RATE_HZ * 1e9).astype(np.int64),
        angular_velocity=0.01 * board.error[:rows] + rng.normal(0.0, 1e-4, shape) + 0.02,
        linear_acceleration=force,
        magnetic_field=np.full(shape, np.nan),
        temperature=board.temperature[:rows] + rng.normal(0.0, 0.03, rows),
        device='board',
        up_axis='+z',
    )


def judged(seed: int, hidden: str) -> dict[str, Any]:
    """Return what is said of one warm-up and of the log there and back, and what cooling left."""
    rng = np.random.default_rng([seed, HIDDEN.index(hidden)])
    board = draw_board(rng, hidden)
    one_way = second_opinion(recorded(board, board.half, rng), 'px4', seed=seed)
    both = second_opinion(recorded(board, len(board.error), rng), 'px4', seed=seed)
    part = one_way.sensors['accelerometer']
    left = board.error - part.cubic.error(board.temperature)
    cooling = left[board.half :] - left[: board.half].mean(axis=0)
    rms = float(np.sqrt(np.mean(cooling**2)))
    return {
        'cannot': not one_way.decidable,
        'can': both.decidable,
        'below': rms <= part.cooling[-1],
        'within': part.cooling[0] <= rms <= part.cooling[-1],
    }


def main() -> int:
    """Judge the logs and print the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--logs', type=int, default=100, help='of each kind')
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    verdicts = []
    for hidden in HIDDEN:
        rows = [judged(s, hidden) for s in range(options.seed, options.seed + options.logs)]
        share = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
        print(f'{hidden} hidden: cooling within the predicted band in {share["within"]:.0%}')
        verdicts += [
            Verdict(f'{hidden}: one way, said not to tell', share['cannot'], TELLS, at_least=True),
            Verdict(f'{hidden}: there and back, said to tell', share['can'], TELLS, at_least=True),
            Verdict(f'{hidden}: cooling below the band', share['below'], HOLDS, at_least=True),
        ]
    return 1 if judge(verdicts) else 0


if __name__ == '__main__':
    raise SystemExit(main())
