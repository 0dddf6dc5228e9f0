# SPDX-License-Identifier: Apache-2.0
"""What the driver's services answer about a device at rest."""

from __future__ import annotations

import json
from typing import Final

from imu_recording.recording import UP_AXES

from imu_driver.axis_map import check_six_positions
from imu_driver.stream_statistics import StreamStatistics

DIGITS: Final = 4


def rest_report(statistics: StreamStatistics) -> str:
    """Return gyroscope bias and the noise of one sample as JSON [rad/s, m/s²]."""
    rest = statistics.rest()
    names = {
        'angular_velocity': 'gyroscope_bias',
        'angular_velocity_stddev': 'angular_velocity_stddev',
        'linear_acceleration_stddev': 'linear_acceleration_stddev',
    }
    return json.dumps(
        {
            name: [float(f'{value:.{DIGITS}g}') for value in rest[key]]
            for key, name in names.items()
        }
    )


class PositionCheck:
    """Collects six positions at rest, one a call, and judges them.

    The positions are named after the axis the sensor says is up, so what is judged here is that
    six different ones are met and each reads g; which marked axis was up the operator sees.
    """

    def __init__(self) -> None:
        self._readings: dict[str, list[float]] = {}

    def take(self, statistics: StreamStatistics) -> str:
        """Take the position the device is in; return which axis is up and what is still to do."""
        axis, mean = statistics.up_axis()
        self._readings[axis] = [float(value) for value in mean]
        reading = ', '.join(f'{value:.2f}' for value in mean)
        told = f'{axis} is up, reads [{reading}] m/s²'
        missing = [name for name in UP_AXES if name not in self._readings]
        if missing:
            return f'{told}; still to come: {", ".join(missing)}'
        faults = check_six_positions(self._readings)
        self._readings = {}
        return f'{told}; all six positions: {"; ".join(faults) or "right"}'
