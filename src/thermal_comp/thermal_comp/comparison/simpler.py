# SPDX-License-Identifier: Apache-2.0
"""Whether a line in temperature, or no model at all, would leave less."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.comparison.compare import Comparison, SensorComparison, part_squares, rms_of
from thermal_comp.comparison.held_out import hold_out
from thermal_comp.data.improvement import falls, rises
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.weights import with_best_weights
from thermal_comp.model.values import ThermalModel

SIMPLER_MODELS: dict[str, tuple[Effect, ...]] = {
    'no model at all': (),
    'a line': (BiasTemperature(),),
}
"""Effects of the models that every model must not be worse than, by name."""
LEAST_SURE_RISE = 2.0
"""Ratio of errors from which a rise is sure, however few the held-out parts."""


def raised(before: SensorComparison, after: SensorComparison) -> bool:
    """Tell whether a sensor's held-out error, over all axes, is larger than it was before."""
    return rises(rms_of(before.held_out_rms), rms_of(after.held_out_rms))


def residual_ratios(part: SensorComparison) -> FloatArray:
    """Return (3,) ratios of the rms that a model leaves of each axis to that which was measured.

    Above LEAST_SURE_RISE it is worse than none, though held-out parts may hide it: what is odd in
    a single part weighs little there.
    """
    return np.asarray(part.residual_rms / np.maximum(part.measured_rms, 1e-300))


def worse_than_simpler(
    model: ThermalModel, compared: Comparison, runs: Sequence[PreparedRun]
) -> tuple[str, ...]:
    """Return a sentence per axis whose error a simpler model lowers beyond chance."""
    worse = []
    for sensor, part in compared.sensors.items():
        fitted = model.sensors[sensor]
        worse += [
            f'{sensor} {axis}: the error is {ratio:.2f} times that of no model at all'
            for axis, ratio in zip('xyz', residual_ratios(part), strict=True)
            if ratio > LEAST_SURE_RISE
        ]
        if fitted.noise is None:
            continue
        for name, effects in SIMPLER_MODELS.items():
            if len(effects) >= len(fitted.effects):
                continue
            noise = with_best_weights(runs, {sensor: effects}, {sensor: fitted.noise})
            held = hold_out(runs, {sensor: effects}, noise)
            squares, floor = part_squares(held, sensor), part.noise_floor**2
            for axis in range(3):
                left, least = part.held_out_squares[:, axis], squares[:, axis]
                rise = float(np.sqrt(left.sum() / max(least.sum(), 1e-300)))
                if rise > LEAST_SURE_RISE or falls(left, least, floor[axis]):
                    worse.append(
                        f'{sensor} {"xyz"[axis]}: the error on held-out parts is {rise:.2f} times '
                        f'that of {name}'
                    )
    return tuple(worse)
