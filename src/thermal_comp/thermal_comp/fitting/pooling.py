# SPDX-License-Identifier: Apache-2.0
"""Whether several devices may share one model: their slopes, device by device and pooled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray, ImuRecording

from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.preparation import Truth, prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ModelError, ThermalModel

COVERAGE_FACTOR = 2.0
"""Of the expanded uncertainties in the normalised difference."""


@dataclass(frozen=True, eq=False)
class PoolingTest:
    """Temperature coefficients of one sensor, device by device and pooled."""

    sensor: str
    devices: tuple[str, ...]
    slopes: FloatArray
    """(devices, 3) [unit/K]."""
    std: FloatArray
    """(devices, 3) standard deviation of each [unit/K]."""
    pooled_slope: FloatArray
    """(3,) of one model for all [unit/K]."""
    own_rms: FloatArray
    """(devices, 3) residual rms under the device's own model [unit]."""
    pooled_rms: FloatArray
    """(devices, 3) residual rms under the pooled model [unit]."""

    @property
    def normalised_difference(self) -> FloatArray:
        """(3,) largest |Δslope| / expanded uncertainty of any two devices (E_n of ISO 13528)."""
        pairs = combinations(range(len(self.devices)), 2)
        differences = [
            np.abs(self.slopes[i] - self.slopes[j])
            / (COVERAGE_FACTOR * np.hypot(self.std[i], self.std[j]))
            for i, j in pairs
        ]
        return np.asarray(np.max(differences, axis=0))

    @property
    def opposite_signs(self) -> list[bool]:
        """Whether an axis has two devices with significant slopes of opposite sign."""
        sure = np.abs(self.slopes) > COVERAGE_FACTOR * self.std
        rising = (sure & (self.slopes > 0.0)).any(axis=0)
        falling = (sure & (self.slopes < 0.0)).any(axis=0)
        return [bool(both) for both in rising & falling]

    @property
    def poolable(self) -> bool:
        """Whether no two devices differ significantly on any axis."""
        return bool((self.normalised_difference <= 1.0).all())

    def lines(self) -> list[str]:
        """Return the test as text, one line per axis."""
        unit = SENSOR_UNITS[self.sensor]
        said = []
        for axis, name in enumerate('xyz'):
            slopes = ', '.join(
                f'{device} {slope:+.3g} ± {COVERAGE_FACTOR * std:.1g}'
                for device, slope, std in zip(
                    self.devices, self.slopes[:, axis], self.std[:, axis], strict=True
                )
            )
            worse = float((self.pooled_rms / self.own_rms)[:, axis].max())
            verdict = 'differ' if self.normalised_difference[axis] > 1.0 else 'agree'
            if self.opposite_signs[axis]:
                verdict = 'have opposite signs'
            said.append(
                f'{self.sensor} {name}: {slopes} {unit}/K: slopes {verdict}, '
                f'E_n = {self.normalised_difference[axis]:.3g}; a pooled slope of '
                f'{self.pooled_slope[axis]:+.3g} leaves up to {worse:.3g} × the residual'
            )
        return said

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            **vars(self),
            'unit': f'{SENSOR_UNITS[self.sensor]}/K',
            'normalised_difference': self.normalised_difference,
            'opposite_signs': self.opposite_signs,
            'poolable': self.poolable,
        }


def examine_pooling(
    recordings: Sequence[ImuRecording], *, truth: Truth | None = None
) -> tuple[ThermalModel, Mapping[str, PoolingTest]]:
    """Return the pooled linear model of several devices and, per sensor, the test of it."""
    return examine_prepared(prepare(recordings, truth=truth))


def examine_prepared(
    runs: Sequence[PreparedRun], known: Mapping[str, ThermalModel] | None = None
) -> tuple[ThermalModel, Mapping[str, PoolingTest]]:
    """Do the same with prepared runs; `known` linear models of devices are not fitted again."""
    known = known or {}
    devices = tuple(sorted({run.device for run in runs}))
    if len(devices) < 2:
        raise ModelError(f'pooling compares devices; all recordings are of {devices[0]!r}')
    line = (BiasTemperature(),)
    pooled = fit_prepared(line, runs, pooled=True)
    own_runs = {device: [run for run in runs if run.device == device] for device in devices}
    own = {device: known.get(device) or fit_prepared(line, own_runs[device]) for device in devices}
    tests: dict[str, PoolingTest] = {}
    for sensor in SENSORS:
        if sensor not in pooled.sensors:
            continue
        parts = [own[device].sensors[sensor] for device in devices]
        slopes = np.array([part.coefficients[0][0] for part in parts])
        together = pooled.sensors[sensor].coefficients[0][0]
        tests[sensor] = PoolingTest(
            sensor=sensor,
            devices=devices,
            slopes=slopes,
            std=np.array([np.sqrt(np.diag(part.covariance)) for part in parts]),
            pooled_slope=together,
            own_rms=np.array(
                [
                    _rms(own_runs[d], sensor, slope)
                    for d, slope in zip(devices, slopes, strict=True)
                ]
            ),
            pooled_rms=np.array([_rms(own_runs[d], sensor, together) for d in devices]),
        )
    return pooled, tests


def _rms(runs: Sequence[PreparedRun], sensor: Sensor, slope: FloatArray) -> FloatArray:
    """Return the (3,) rms that a slope leaves, about the mean of each run."""
    left = []
    for run in runs:
        residual = run.measured[sensor] - run.temperature[:, None] * slope
        left.append(residual - np.nanmean(residual, axis=0))
    rms: FloatArray = np.sqrt(np.nanmean(np.concatenate(left) ** 2, axis=0))
    return rms
