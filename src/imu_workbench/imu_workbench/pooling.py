# SPDX-License-Identifier: Apache-2.0
"""The paper's argument against one model for all devices: slopes of opposite sign (section V)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray
from thermal_comp.conditions import SENSORS, Sensor
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fit import fit_prepared
from thermal_comp.model import NoiseModel, ThermalModel
from thermal_comp.prepared_run import PreparedRun

from imu_workbench.run_errors import errors_of_run


@dataclass(frozen=True, eq=False)
class Pooling:
    """One sensor under a model for each device and under one for all, SI units."""

    sensor: str
    slopes: Mapping[str, FloatArray]
    """(3,) of each device [unit/K]."""
    opposite: NDArray[np.bool_]
    """(3,) two devices' slopes have opposite signs, each beyond twice its uncertainty."""
    measured_rms: FloatArray
    individual_rms: FloatArray
    pooled_rms: FloatArray
    """(3,) rms of block means over all runs [unit]."""


def compare_pooling(
    runs: Sequence[PreparedRun],
    pooled: ThermalModel | None = None,
    noise: Mapping[Sensor, NoiseModel] | None = None,
) -> list[Pooling]:
    """Return both ways per sensor; none where the runs are of one device.

    `noise` saves estimating it again where it is known; it only weights the fits.
    """
    devices = sorted({run.device for run in runs})
    if len(devices) < 2:
        return []
    line = [BiasTemperature()]
    noise = noise or known_noise(pooled)
    together = pooled or fit_prepared(line, runs, pooled=True, noise=noise)
    own = {
        device: fit_prepared(line, [run for run in runs if run.device == device], noise=noise)
        for device in devices
    }
    sensors = [s for s in SENSORS if all(s in m.sensors for m in (together, *own.values()))]
    return [_compare_sensor(sensor, runs, together, own) for sensor in sensors]


def known_noise(model: ThermalModel | None) -> dict[Sensor, NoiseModel] | None:
    """Return the noise a model was fitted with; None where there is none."""
    if model is None:
        return None
    found = ((s, model.sensors[s].noise) for s in SENSORS if s in model.sensors)
    return {sensor: noise for sensor, noise in found if noise is not None}


def _compare_sensor(
    sensor: Sensor,
    runs: Sequence[PreparedRun],
    together: ThermalModel,
    own: Mapping[str, ThermalModel],
) -> Pooling:
    slopes, signs = {}, []
    for device, model in own.items():
        part = model.sensors[sensor]
        slope = part.coefficients[0].reshape(-1, 3)[0]
        certain = np.abs(slope) > 2.0 * np.sqrt(np.diag(part.covariance)[:3])
        slopes[device] = slope
        signs.append(np.sign(slope) * certain)
    individual = [errors_of_run(run, own[run.device]) for run in runs]
    pooled = [errors_of_run(run, together) for run in runs]
    return Pooling(
        sensor=sensor,
        slopes=slopes,
        opposite=(np.min(signs, axis=0) < 0) & (np.max(signs, axis=0) > 0),
        measured_rms=_rms([run.measured[sensor] for run in individual]),
        individual_rms=_rms([run.residual(sensor) for run in individual]),
        pooled_rms=_rms([run.residual(sensor) for run in pooled]),
    )


def _rms(parts: Sequence[FloatArray]) -> FloatArray:
    together = np.concatenate(list(parts))
    rms: FloatArray = np.sqrt(np.nanmean(together**2, axis=0))
    return rms
