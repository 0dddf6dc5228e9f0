# SPDX-License-Identifier: Apache-2.0
"""The simulated device sample by sample, as the emulated board reads it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from imu_recording.jit import entry_of, njit
from imu_recording.recording import FloatArray

from imu_driver.board.lsm9ds1 import (
    AXIS_SIGNS,
    COUNT_MAX,
    COUNT_MIN,
    SENSORS,
    TEMPERATURE_SENSITIVITY_C,
    ZERO_COUNT_TEMPERATURE_C,
    scale,
)
from imu_driver.simulation.devices import (
    REFERENCE_TEMPERATURE,
    SENSOR_RATE_HZ,
    DeviceParameters,
    ThermalNetwork,
    find_device,
)
from imu_driver.simulation.environment import EARTH_RATE, LOCAL_GRAVITY, MAGNETIC_FIELD
from imu_driver.simulation.noise import CORRELATION_TIMES, PROCESS_STD
from imu_driver.simulation.pose import pose_matrix, rotation_vector_matrix
from imu_driver.simulation.read_out import G_SENSITIVITY_PATTERN
from imu_driver.simulation.run import PLACEMENT_STD, bandgap_current, stress_strain
from imu_driver.simulation.thermal import (
    DIE,
    LONGEST_SUBSTEP_S,
    MAGNETOMETER,
    steady_nodes,
    step_nodes,
)

_BLOCK_SAMPLES = 512
_CHANNEL_COUNT = 9
_PROCESS_COUNT = len(CORRELATION_TIMES)

Counts = tuple[int, int, int]


class SimulatedDevice:
    """A device at rest, read one sample after the other.

    The same physics as `simulate_device`: heat in the board, thermal laws, flicker and white
    noise, counts. Times rise from call to call; equal seeds and calls give equal counts.
    """

    def __init__(
        self,
        device: str | DeviceParameters,
        *,
        seed: int,
        full_scale: Mapping[str, float],
        orientation: str = '+z',
    ) -> None:
        self.device = find_device(device)
        self._generator = np.random.default_rng((seed, 7))
        self._normals = np.empty((0, _CHANNEL_COUNT * (_PROCESS_COUNT + 1) + 1))
        self._used = 0
        self._step: Callable[..., Any] = self._first_step
        self._time: float | None = None
        self._nodes = np.empty(4)
        self._processes = self._generator.standard_normal((_PROCESS_COUNT, _CHANNEL_COUNT))
        self.full_scale = full_scale
        self._prepare(orientation)

    @property
    def full_scale(self) -> dict[str, float]:
        """Full scale per sensor in datasheet units; may be set between samples."""
        return dict(self._full_scale)

    @full_scale.setter
    def full_scale(self, full_scale: Mapping[str, float]) -> None:
        self._full_scale = dict(full_scale)
        self._sensitivity = np.concatenate(
            [np.abs(scale(sensor, full_scale[sensor])) for sensor in SENSORS]
        )

    @property
    def die_temperature(self) -> float:
        """True temperature of the accelerometer and gyroscope die [°C]."""
        return float(self._nodes[DIE])

    @property
    def rate_factor(self) -> float:
        """True output data rate relative to the nominal one, now."""
        above = self.die_temperature - REFERENCE_TEMPERATURE
        return (1.0 + self.device.rate_error) * (1.0 + self.device.rate_slope * above)

    def sample(self, time_s: float, ambient_c: float) -> tuple[Counts, Counts, Counts, int]:
        """Return the counts at a time [s] in air of a temperature [°C].

        Gyroscope, accelerometer and magnetometer in chip axes, then the thermometer.
        """
        if self._time is None:
            self._nodes[:] = steady_nodes(self.device.network, ambient_c)
            step = 0.0
        else:
            step = max(time_s - self._time, 0.0)
        self._time = time_s
        if self._used == len(self._normals):
            self._normals = self._generator.standard_normal(
                (_BLOCK_SAMPLES, self._normals.shape[1])
            )
            self._used = 0
        counts = self._step(
            self._nodes,
            self._processes,
            self.device.network,
            self._constants,
            self._sensitivity,
            ambient_c,
            step,
            self._normals[self._used],
        ).tolist()
        self._used += 1
        return tuple(counts[:3]), tuple(counts[3:6]), tuple(counts[6:9]), counts[9]

    def _first_step(self, *arguments: Any) -> Any:
        counts = _advance(*arguments)
        self._step = entry_of(_advance, arguments)
        return counts

    def _prepare(self, orientation: str) -> None:
        """Collect the constants of each channel: the three triads, then the thermometer."""
        device = self.device
        placement = rotation_vector_matrix(self._generator.normal(0.0, PLACEMENT_STD, 3))
        matrix = placement @ pose_matrix(orientation)
        force = matrix @ np.array([0.0, 0.0, LOCAL_GRAVITY])
        world = {
            'gyroscope': matrix @ EARTH_RATE,
            'accelerometer': force,
            'magnetometer': matrix @ MAGNETIC_FIELD,
        }
        rows = []
        for sensor in SENSORS:
            part = device.sensor(sensor)
            turned = rotation_vector_matrix(part.misalignment) @ world[sensor]
            seen = (1.0 + part.scale_error) * turned
            level = part.bias + self._generator.normal(0.0, 1.0, 3) * part.turn_on_std
            if sensor == 'gyroscope':
                level = level + device.g_sensitivity * force @ G_SENSITIVITY_PATTERN
            rows.append(
                np.column_stack(
                    [
                        level + seen,
                        part.slope + part.scale_slope * seen,
                        part.mean_std,
                        np.full(3, part.bias_instability),
                        np.full(3, part.stiffening),
                        np.array(AXIS_SIGNS[sensor], dtype=float),
                    ]
                )
            )
        thermometer = [
            device.thermometer_offset,
            device.thermometer_gain,
            device.thermometer_noise,
            0,
            0,
            0,
        ]
        self._constants = np.vstack([*rows, thermometer])


@njit(cache=True)
def _advance(
    nodes: FloatArray,
    processes: FloatArray,
    network: ThermalNetwork,
    constants: FloatArray,
    sensitivity: FloatArray,
    air: float,
    step: float,
    normals: FloatArray,
) -> np.ndarray:
    """Advance heat and noise in place by `step` seconds and return the (10,) counts."""
    if step > 0.0:
        substeps = int(np.ceil(step / LONGEST_SUBSTEP_S))
        for _ in range(substeps):
            step_nodes(nodes, network, air, step / substeps)
        for p in range(_PROCESS_COUNT):
            decay = np.exp(-step / CORRELATION_TIMES[p])
            kick = np.sqrt(1.0 - decay * decay)
            for c in range(_CHANNEL_COUNT):
                processes[p, c] = decay * processes[p, c] + kick * normals[p * _CHANNEL_COUNT + c]
    rate = SENSOR_RATE_HZ
    if step > 0.0:
        rate = max(1.0 / step, SENSOR_RATE_HZ)
    counts = np.empty(10, dtype=np.int64)
    for c in range(_CHANNEL_COUNT):
        level, slope, white, instability, bend, sign = constants[c]
        magnetic = c >= 6
        x = nodes[MAGNETOMETER if magnetic else DIE] - REFERENCE_TEMPERATURE
        load = bandgap_current(x, bend) if magnetic else stress_strain(x, bend)
        flicker = 0.0
        for p in range(_PROCESS_COUNT):
            flicker += processes[p, c]
        noise = white * np.sqrt(rate) * normals[_PROCESS_COUNT * _CHANNEL_COUNT + c]
        value = level + slope * load + PROCESS_STD * instability * flicker + noise
        count = np.rint(sign * value / sensitivity[c])
        counts[c] = int(min(max(count, COUNT_MIN), COUNT_MAX))
    offset, gain, noise = constants[9, 0], constants[9, 1], constants[9, 2]
    above = (nodes[DIE] - REFERENCE_TEMPERATURE) * (1.0 + gain)
    shown = REFERENCE_TEMPERATURE + above + offset + noise * normals[-1]
    counts[9] = int(np.rint((shown - ZERO_COUNT_TEMPERATURE_C) / TEMPERATURE_SENSITIVITY_C))
    return counts
