# SPDX-License-Identifier: Apache-2.0
"""The catalogue of physical effects, one file each."""

from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect, State, shape_parameter

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        BiasTemperature,
    )
}
"""Every effect of the catalogue by name."""

__all__ = ['EFFECTS', 'Effect', 'State', 'shape_parameter']
