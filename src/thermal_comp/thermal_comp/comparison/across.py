# SPDX-License-Identifier: Apache-2.0
"""Whether the model of one device is good enough for another.

For every ordered pair of devices the model fitted to the one is applied to the runs of the other,
levels taken from these runs. It is compared with no model, and with the device's own model on runs
that it was not fitted to: whole runs are held out, with levels of their own, as another device has
no part of a run from which `held_out` could take them. Two values of a coefficient are compatible
where they differ by at most twice the standard uncertainty of their difference (JCGM 200:2012,
2.47).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray

from thermal_comp.comparison.compare import rms_of
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ModelError, ThermalModel

COVERAGE_FACTOR = 2.0
"""Of the expanded uncertainty of a difference."""


@dataclass(frozen=True)
class DevicePair:
    """The model of one device on the runs of another, in one sensor; rms over axes [unit]."""

    model: str
    device: str
    sensor: Sensor
    unit: str
    raw: float
    """Without a model, about the mean of each run."""
    own: float
    """With the device's own model: of its other runs where it has several, else of the same."""
    foreign: float
    """With the other device's model."""
    compatible: int
    """Coefficients that are compatible."""
    coefficients: int

    @property
    def good_enough(self) -> bool:
        """Whether every coefficient is compatible."""
        return self.compatible == self.coefficients

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {**asdict(self), 'good_enough': self.good_enough}


def compare_across(effects: Sequence[Effect], runs: Sequence[PreparedRun]) -> list[DevicePair]:
    """Return every ordered pair of devices by sensor; ModelError where there is one device only.

    `effects` have no shape parameters that are searched, so that their coefficients compare.
    """
    by_device: dict[str, list[PreparedRun]] = defaultdict(list)
    for run in runs:
        by_device[run.device].append(run)
    if len(by_device) < 2:
        raise ModelError(
            f'only {", ".join(by_device)}: a comparison across devices needs the runs of two'
        )
    models = {name: fit_prepared(effects, own) for name, own in by_device.items()}
    found = []
    for device, own in by_device.items():
        held_out = _held_out(effects, own, models[device])
        for other, model in models.items():
            for sensor in SENSORS:
                if other == device or not {sensor} <= set(model.sensors) & set(held_out):
                    continue
                compatible = _compatible(model, models[device], sensor)
                found.append(
                    DevicePair(
                        model=other,
                        device=device,
                        sensor=sensor,
                        unit=SENSOR_UNITS[sensor],
                        raw=_rms(own, None, sensor),
                        own=held_out[sensor],
                        foreign=_rms(own, model, sensor),
                        compatible=int(compatible.sum()),
                        coefficients=len(compatible),
                    )
                )
    return found


def _held_out(
    effects: Sequence[Effect], runs: Sequence[PreparedRun], whole: ThermalModel
) -> dict[Sensor, float]:
    """Return the rms of a device's own model, fitted without each run where there are several."""
    models = [
        fit_prepared(effects, [other for other in runs if other is not run])
        if len(runs) > 1
        else whole
        for run in runs
    ]
    return {
        sensor: rms_of(
            np.concatenate([_residual(r, m, sensor) for r, m in zip(runs, models, strict=True)])
        )
        for sensor in SENSORS
        if all(sensor in model.sensors for model in models)
    }


def _rms(runs: Sequence[PreparedRun], model: ThermalModel | None, sensor: Sensor) -> float:
    """Return the rms over axes that a model, or none, leaves in runs."""
    return rms_of(np.concatenate([_residual(run, model, sensor) for run in runs]))


def _residual(run: PreparedRun, model: ThermalModel | None, sensor: Sensor) -> FloatArray:
    """Return (m, 3) block means minus the model, about their mean."""
    left = np.array(run.measured[sensor])
    if model is not None:
        error, _ = model.sensors[sensor].modelled_error(run.conditions.of(sensor))
        left = left - run.block_mean(error)
    centred: FloatArray = left - np.nanmean(left, axis=0)
    return centred


def _compatible(first: ThermalModel, second: ThermalModel, sensor: Sensor) -> FloatArray:
    """Return whether each coefficient of one model is compatible with that of the other."""
    values, variances = [], []
    for model in (first, second):
        part = model.sensors[sensor]
        values.append(np.concatenate([c.ravel() for c in part.coefficients]))
        variances.append(np.diag(part.covariance))
    difference = np.abs(values[0] - values[1])
    within: FloatArray = difference <= COVERAGE_FACTOR * np.sqrt(variances[0] + variances[1])
    return within
