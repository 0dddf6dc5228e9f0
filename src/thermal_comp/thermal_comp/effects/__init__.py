# SPDX-License-Identifier: Apache-2.0
"""The catalogue of physical effects, one file each."""

from thermal_comp.effects.bias_creep import BiasCreep
from thermal_comp.effects.bias_drift import BiasDrift
from thermal_comp.effects.bias_step import BiasStep
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.bias_temperature_curvature import BiasTemperatureCurvature
from thermal_comp.effects.compressor_hard_iron import CompressorHardIron
from thermal_comp.effects.effect import (
    COUNT_UNIT,
    FLIP_ACTION,
    Campaign,
    Candidate,
    Effect,
    Kin,
    State,
    shape_parameter,
)
from thermal_comp.effects.empirical_term import Empirical
from thermal_comp.effects.fixture_hard_iron import FixtureHardIron
from thermal_comp.effects.fixture_tilt import FixtureTilt
from thermal_comp.effects.g_sensitivity_temperature import GSensitivityTemperature
from thermal_comp.effects.heater_hard_iron import HeaterHardIron
from thermal_comp.effects.humidity import Humidity
from thermal_comp.effects.icing import Icing
from thermal_comp.effects.mains_alias import MainsAlias
from thermal_comp.effects.misalignment_temperature import MisalignmentTemperature
from thermal_comp.effects.scale_factor_temperature import ScaleFactorTemperature
from thermal_comp.effects.supply_sensitivity import SupplySensitivity
from thermal_comp.effects.temperature_rate import TemperatureRate
from thermal_comp.effects.thermal_gradient import ThermalGradient
from thermal_comp.effects.thermal_hysteresis import ThermalHysteresis
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.effects.thermal_lag_two_stage import ThermalLagTwoStage
from thermal_comp.effects.turn_on_bias import TurnOnBias
from thermal_comp.effects.vibration_rectification import VibrationRectification
from thermal_comp.effects.warm_up import WarmUp

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        BiasTemperature,
        BiasTemperatureCurvature,
        ScaleFactorTemperature,
        MisalignmentTemperature,
        GSensitivityTemperature,
        ThermalLag,
        ThermalLagTwoStage,
        TemperatureRate,
        ThermalGradient,
        ThermalHysteresis,
        WarmUp,
        SupplySensitivity,
        VibrationRectification,
        Humidity,
        Empirical,
        TurnOnBias,
        BiasStep,
        BiasDrift,
        BiasCreep,
        HeaterHardIron,
        CompressorHardIron,
        FixtureHardIron,
        FixtureTilt,
        MainsAlias,
        Icing,
    )
}
"""Every effect of the catalogue by name, device effects first."""

__all__ = [
    'COUNT_UNIT',
    'EFFECTS',
    'FLIP_ACTION',
    'Campaign',
    'Candidate',
    'Effect',
    'Kin',
    'State',
    'shape_parameter',
]
