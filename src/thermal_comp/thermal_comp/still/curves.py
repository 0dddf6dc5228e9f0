# SPDX-License-Identifier: Apache-2.0
"""Temperature curves of accelerometer and gyroscope from the stretches at rest of many logs.

The curve is a line, smooth bends (`empirical_term` without history) and, where the evidence is
for it, a lag; `levels.py` has the equations of the stretches' levels. The result is a thermal
model like any other. Between the temperatures that were visited the bends are as uncertain as
their size allows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import INERTIAL_SENSORS, Sensor, settled_conditions
from thermal_comp.fitting.fit import package_version
from thermal_comp.fitting.inputs import check_temperature, device_of, usable_sensors
from thermal_comp.model.values import ModelError, Provenance, ThermalModel
from thermal_comp.still.log import PERIOD_S, RestingLog
from thermal_comp.still.pool import YEAR_S, Pool, SensorCurve

POSE_NOTE = (
    'accelerometer: what its scale changes with temperature is part of the curve, in the poses in '
    'which it rested'
)


@dataclass(frozen=True, eq=False)
class StillCurves:
    """Curves from stretches at rest, and the logs and temperatures they come from."""

    model: ThermalModel
    logs: Sequence[RestingLog]
    """Logs that have a stretch at rest."""
    ages: FloatArray
    """(logs,) years before the newest; NaN where the date is not known."""
    sensors: Mapping[Sensor, SensorCurve]
    temperature: FloatArray
    """(b,) whole degrees of the range [°C]."""
    minutes: FloatArray
    """(b,) time at rest within half a degree of each [min]."""
    odd: Sequence[str]
    """Stretches that were left out, as their level is odd."""

    @property
    def base(self) -> float:
        """Temperature from which curves count: the reference, or the end nearest to it [°C]."""
        reference = self.model.reference_temperature
        return float(np.clip(reference, self.temperature[0], self.temperature[-1]))

    def curve(self, sensor: Sensor, temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the (n, 3) change of the settled error since `base`, and its std [unit]."""
        part = self.model.sensors[sensor]
        rows = [
            effect.columns(settled_conditions(t, self.model.reference_temperature))[0]
            for t in (*temperature.tolist(), self.base)
            for effect in part.effects
        ]
        k = len(part.effects)
        columns = np.array([np.concatenate(rows[i : i + k], 1)[0] for i in range(0, len(rows), k)])
        columns = columns[:-1] - columns[-1]
        coefficients = np.concatenate(part.coefficients)
        p = len(coefficients)
        each = part.covariance.reshape(p, 3, p, 3)
        variance = [np.einsum('np,pq,nq->n', columns, each[:, a, :, a], columns) for a in range(3)]
        return columns @ coefficients, np.sqrt(np.maximum(np.stack(variance, axis=1), 0.0))


def still_curves(logs: Sequence[RestingLog]) -> StillCurves:
    """Return the curves of one device from the stretches at rest of its logs.

    Raises ModelError where there is nothing to fit: no rest, one temperature, several devices.
    """
    resting = [log for log in logs if log.runs]
    if not resting:
        raise ModelError('; '.join(f'{log.name}: {log.note}' for log in logs) or 'no logs')
    runs = [run for log in resting for run in log.runs]
    of_log = np.repeat(np.arange(len(resting)), [len(log.runs) for log in resting])
    device = device_of(runs)
    temperatures = np.concatenate([run.temperature for run in runs])
    check_temperature(runs)
    span = float(temperatures.min()), float(temperatures.max())
    known, notes = usable_sensors(runs)
    # Stretches at rest in unknown poses determine no curve of a magnetometer.
    sensors = [sensor for sensor in INERTIAL_SENSORS if sensor in known]
    if len(sensors) < len(INERTIAL_SENSORS):
        raise ModelError('; '.join(notes))
    ages = _ages(resting)
    pools = {sensor: Pool(runs, of_log, ages, sensor, span) for sensor in sensors}
    odd = [f'{sensor}: {name}' for sensor, pool in pools.items() for name in pool.odd]
    said = [*(note for pool in pools.values() for note in pool.notes), POSE_NOTE]
    model = ThermalModel(
        device=device,
        sensors={sensor: pool.model() for sensor, pool in pools.items()},
        reference_temperature=runs[0].conditions.reference_temperature,
        provenance=Provenance(
            sources={run.name: run.hash for run in runs},
            version=package_version(),
            notes=(*said, *(f'left out, its level is odd: {name}' for name in odd)),
        ),
    )
    degrees = np.array(range(round(span[0]), round(span[1]) + 1), dtype=np.float64)
    rows = np.round(temperatures - degrees[0]).astype(int).clip(0, len(degrees) - 1)
    blocks = np.bincount(rows, minlength=len(degrees)).astype(np.float64)
    minutes = blocks * (PERIOD_S / 60.0)
    found = {sensor: pool.sensor_curve() for sensor, pool in pools.items()}
    return StillCurves(
        model=model,
        logs=resting,
        ages=ages,
        sensors=found,
        temperature=degrees,
        minutes=minutes,
        odd=odd,
    )


def _ages(logs: Sequence[RestingLog]) -> FloatArray:
    started = np.array([np.nan if log.started is None else log.started for log in logs])
    newest = np.nanmax(started) if np.isfinite(started).any() else np.nan
    ages: FloatArray = (newest - started) / YEAR_S
    return ages
