# SPDX-License-Identifier: Apache-2.0
"""What is kept of runs: once for each set of arguments, and no longer than the runs."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from thermal_comp.data.kept_results import kept
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_drift import BiasDrift
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.model.values import NoiseModel

from ..campaign import run

NOISE = NoiseModel(np.ones(3), np.array([60.0]), np.ones((1, 3)))


def test_a_result_is_computed_once_for_runs_effects_and_noise() -> None:
    calls: list[int] = []

    @kept
    def answer(
        runs: Sequence[PreparedRun],
        effects: Mapping[str, Sequence[Effect]],
        noise: NoiseModel = NOISE,
    ) -> int:
        calls.append(len(runs))
        return len(calls)

    one, other = prepare([run('+x', seed=1, cycles=2), run('+y', seed=2, cycles=2)])
    line = {'gyroscope': [BiasTemperature()]}
    same_noise = replace(NOISE, white=NOISE.white.copy())
    first = answer([one, other], line, noise=NOISE)
    assert answer((one, other), {'gyroscope': (BiasTemperature(),)}, noise=same_noise) == first
    further = [
        answer([one], line, noise=NOISE),
        answer([other, one], line, noise=NOISE),
        answer([one, other], {'gyroscope': [BiasDrift()]}, noise=NOISE),
        answer([one, other], line, noise=replace(NOISE, white=2.0 * NOISE.white)),
        answer([one, other], line, noise=replace(NOISE, white_factors={one.name: 2.0})),
    ]
    one.measured['gyroscope'][0] += 1.0
    further.append(answer([one, other], line, noise=NOISE))
    assert len({first, *further}) == 7


def test_nothing_keeps_the_runs() -> None:
    @kept
    def answer(runs: Sequence[PreparedRun]) -> int:
        return len(runs)

    runs = prepare([run('+x', seed=1, cycles=2), run('+y', seed=2, cycles=2)])
    assert answer(runs) == 2
    alive = [weakref.ref(one) for one in runs]
    del runs
    gc.collect()
    assert not any(one() for one in alive)
