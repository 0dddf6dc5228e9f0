# SPDX-License-Identifier: Apache-2.0
"""The coefficients of a fleet as arrays: a row a device, the axes of a sensor side by side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, IntArray
from numpy.typing import NDArray
from thermal_comp.presentation.display import coefficient_unit

from imu_workbench.fleet.table import FleetTable

Strings = NDArray[np.str_]
SENSORS = tuple(SENSOR_FIELDS)


@dataclass(frozen=True, eq=False)
class Vectors:
    """One sensor of n devices."""

    sensor: str
    unit: str
    device: Strings
    type: Strings
    lot: Strings
    coefficients: FloatArray
    """(n, 3) change of bias per kelvin, axes x, y, z."""
    std: FloatArray
    """(n, 3) standard deviations of the fit."""
    run_std: FloatArray
    """(n, 3) standard deviation of the runs' own coefficients about the device's; NaN for one."""
    runs: IntArray
    """(n,)"""
    misfit: FloatArray
    """(n,) logarithm of held-out error over noise floor, mean of the axes."""
    measured_at: IntArray
    """(n,) stamp of the first sample [ns]."""

    def __len__(self) -> int:
        return len(self.device)

    def of(self, chosen: NDArray[np.bool_]) -> Vectors:
        """Return the chosen devices."""
        names = ('device', 'type', 'lot', 'coefficients', 'std', 'run_std', 'runs', 'misfit')
        taken = {name: getattr(self, name)[chosen] for name in (*names, 'measured_at')}
        return replace(self, **taken)

    def displayed(self) -> Vectors:
        """Return the same in the unit people read."""
        unit = coefficient_unit(self.sensor, self.unit)
        scaled = (unit.of(v) for v in (self.coefficients, self.std, self.run_std))
        coefficients, std, run_std = scaled
        return replace(self, unit=unit.unit, coefficients=coefficients, std=std, run_std=run_std)

    def groups(self) -> Iterator[tuple[tuple[str, str], Vectors]]:
        """Yield (type, lot) and its devices."""
        for kind in np.unique(self.type):
            for lot in np.unique(self.lot[self.type == kind]):
                yield (str(kind), str(lot)), self.of((self.type == kind) & (self.lot == lot))


def read_vectors(table: FleetTable, sensor: str) -> Vectors:
    """Return the devices that were estimated, in order of their names."""
    rows = table.rows(
        """SELECT any_value(unit), device, any_value(type), any_value(lot),
                  list(coefficients[1] ORDER BY axis), list(std[1] ORDER BY axis),
                  list(list_var_samp(run_coefficients) ORDER BY axis),
                  any_value(len(run_coefficients)),
                  avg(ln(held_out_rms / noise_floor)), any_value(measured_at)
           FROM results WHERE role = 'fitted' AND sensor = $sensor
           GROUP BY source, device HAVING count(*) = 3 ORDER BY device""",
        sensor=sensor,
    )
    unit, device, kind, lot, values, std, variance, runs, misfit, at = (
        zip(*rows, strict=True) if rows else ((),) * 10
    )
    spread = np.array([[np.nan if v is None else v for v in row] for row in variance], float)
    return Vectors(
        sensor=sensor,
        unit=unit[0] if unit else '',
        device=np.array(device, dtype=np.str_),
        type=np.array(kind, dtype=np.str_),
        lot=np.array(lot, dtype=np.str_),
        coefficients=np.array(values, dtype=float).reshape(-1, 3),
        std=np.array(std, dtype=float).reshape(-1, 3),
        run_std=np.sqrt(spread.reshape(-1, 3)),
        runs=np.array(runs, dtype=np.int64),
        misfit=np.array(misfit, dtype=float),
        measured_at=np.array(at, dtype=np.int64),
    )
