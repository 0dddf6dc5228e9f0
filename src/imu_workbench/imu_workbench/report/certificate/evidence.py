# SPDX-License-Identifier: Apache-2.0
"""What the uncertainty budgets of one sensor are computed from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.model.values import SensorModel
from thermal_comp.noise.process import mean_autocovariance

from imu_workbench.report.certificate.joint_design import JointDesign
from imu_workbench.report.certificate.replicates import Replicates
from imu_workbench.report.laboratory import Laboratory


@dataclass(frozen=True, eq=False)
class Evidence:
    """Model, runs and statements about one sensor."""

    sensor: Sensor
    model: SensorModel
    runs: tuple[PreparedRun, ...]
    up_axes: tuple[str, ...]
    """Axis that points up in each run; '' where unknown."""
    repeated: Replicates
    joint: JointDesign
    """All coefficients and shape parameters over all runs together."""
    laboratory: Laboratory
    span: float
    """Range of die temperature [K]."""
    gradient: FloatArray | None
    """Thermocouple minus die temperature of each dwell [K]; None: no thermocouple was logged."""
    reference_temperature: float

    @property
    def slope(self) -> FloatArray:
        """(3,) slope of the bias over temperature, zero where the model has none."""
        for effect, coefficients in zip(self.model.effects, self.model.coefficients, strict=True):
            if effect.temperature_coefficient:
                return np.asarray(coefficients[0])
        return np.zeros(3)

    def noise_degrees(self, axis: int) -> float:
        """Return the degrees of freedom of the noise's variance: n / Σ ρ² less one (Bartlett)."""
        assert self.model.noise is not None  # noqa: S101 (every fit has one)
        degrees = 0.0
        for run in self.runs:
            covariance = mean_autocovariance(self.model.noise, axis, run.period, len(run))
            rho = covariance / covariance[0] if covariance[0] > 0.0 else np.eye(1, len(run))[0]
            degrees += len(run) / (2.0 * float((rho**2).sum()) - 1.0)
        return max(1.0, degrees - 1.0)
