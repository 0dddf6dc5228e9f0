# SPDX-License-Identifier: Apache-2.0
"""Every effect the simulated device can hide, by name."""

from __future__ import annotations

from imu_driver import (
    simulated_effects_beyond,
    simulated_effects_chamber,
    simulated_effects_heat,
    simulated_effects_session,
)
from imu_driver.simulated_effect import Law

LAWS: dict[str, Law] = {
    law.name: law
    for module in (
        simulated_effects_heat,
        simulated_effects_session,
        simulated_effects_chamber,
        simulated_effects_beyond,
    )
    for law in module.LAWS
}
"""Name → law."""

CHANNEL_OF = {
    'heater_hard_iron': ('heater',),
    'compressor_hard_iron': ('compressor',),
    'supply_sensitivity': ('supply_voltage',),
    'vibration_rectification': ('vibration', 'compressor'),
    'humidity': ('humidity',),
}
"""Laws that can be hidden with the logs that would betray them taken away; first: what it is."""
