# SPDX-License-Identifier: Apache-2.0
"""A rate is a derivative: how long it is smoothed depends on the noise of the thermometer."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.temperature_rate import TemperatureRate
from thermal_comp.fitting.fit import fit_prepared

from imu_recording import ImuRecording

from ..campaign import WHITE, slow_days

FIELD, SENSOR = 'angular_velocity', 'gyroscope'


def days_with_a_rate() -> tuple[ImuRecording, np.ndarray]:
    """Two days whose gyroscope feels the rate, and the temperature of the die itself."""
    dies = []

    def error(time: np.ndarray, die: np.ndarray) -> dict[str, np.ndarray]:
        dies.append(die)
        rate = np.gradient(die, time)
        return {FIELD: np.multiply.outer(10.0 * rate / rate.std(), WHITE[FIELD] * np.ones(3))}

    return slow_days(error), dies[0]


def smoothing_and_error(recording: ImuRecording) -> tuple[float, float]:
    """Return the time constant that a fit takes [s], and the held-out error beside a line's."""
    runs = prepare([recording])
    line = fit_prepared([BiasTemperature()], runs)
    model = fit_prepared([BiasTemperature(), TemperatureRate()], runs)
    left = [compare_prepared(m, runs).sensors[SENSOR].held_out_rms.mean() for m in (model, line)]
    rate = model.sensors[SENSOR].effects[1]
    assert isinstance(rate, TemperatureRate)
    return rate.smoothing, float(left[0] / left[1])


@pytest.mark.long
def test_a_coarse_thermometer_is_smoothed_for_longer_and_then_helps() -> None:
    coarse, die = days_with_a_rate()
    long, left = smoothing_and_error(coarse)
    short, left_by_a_good_one = smoothing_and_error(replace(coarse, temperature=die))
    assert short <= 100.0 < long
    assert left_by_a_good_one < left < 0.6
