# SPDX-License-Identifier: Apache-2.0
"""Whether a line in temperature, or no model at all, would leave less on held-out parts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thermal_comp.comparison.compare import Comparison, part_squares
from thermal_comp.comparison.held_out import hold_out
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.part_sums import falls
from thermal_comp.model.values import ThermalModel

SIMPLER: dict[str, tuple[Effect, ...]] = {
    'no model at all': (),
    'a line': (BiasTemperature(),),
}
"""What a model has to be as good as, by name."""


def worse_than_simpler(
    model: ThermalModel, compared: Comparison, runs: Sequence[PreparedRun]
) -> tuple[str, ...]:
    """Return a sentence per axis whose held-out error something simpler lowers beyond chance."""
    worse = []
    for sensor, part in compared.sensors.items():
        fitted = model.sensors[sensor]
        if fitted.noise is None:
            continue
        for name, effects in SIMPLER.items():
            if len(effects) >= len(fitted.effects):
                continue
            held = hold_out(runs, {sensor: effects}, {sensor: fitted.noise})
            squares, floor = part_squares(held, sensor), part.noise_floor**2
            for axis in range(3):
                if falls(part.held_out_squares[:, axis], squares[:, axis], floor[axis]):
                    rise = float(
                        np.sqrt(part.held_out_squares[:, axis].sum() / squares[:, axis].sum())
                    )
                    worse.append(
                        f'{sensor} {"xyz"[axis]}: the error on held-out parts is {rise:.2f} times '
                        f'that of {name}'
                    )
    return tuple(worse)
