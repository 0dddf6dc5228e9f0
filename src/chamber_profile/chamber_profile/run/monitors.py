# SPDX-License-Identifier: Apache-2.0
"""Monitors of a run: whether the IMU sends, reference temperatures, errors of the recorder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from imu_recording.ros.diagnostics import node_of
from sensor_msgs.msg import Temperature

from chamber_profile.run.conductor import ExternalReadings
from chamber_profile.run.config import ChamberConfig

SILENCE_TIMEOUT_S = 10.0
"""A source silent for this time has failed [s]."""
ERROR_LEVEL = 2
"""DiagnosticStatus.ERROR."""


class RunMonitors:
    """Keep the newest message of each source; `readings` sums them up."""

    def __init__(self, config: ChamberConfig, now: Callable[[], int]) -> None:
        self._config = config
        self._now = now
        self._imu_stamp = now()
        self._air: tuple[int, float] | None = None
        self._device: tuple[int, float] | None = None
        self._recorder_error = ''

    def inputs(self) -> Iterator[tuple[type, str, Callable[[Any], None]]]:
        """Yield type, topic and callback of every subscription."""
        for topic in self._config.imu_topics if self._config.require_imu else []:
            yield Temperature, topic, self.on_imu
        if not self._config.publish_temperature:
            yield Temperature, 'chamber/temperature', self.on_air
            yield Temperature, 'chamber/device_temperature', self.on_device
        yield DiagnosticArray, '/diagnostics', self.on_diagnostics

    def restart_imu_timeout(self) -> None:
        """Let the IMU's time-out begin now."""
        self._imu_stamp = self._now()

    def on_imu(self, _: Temperature) -> None:
        """Take a message of the IMU."""
        self._imu_stamp = self._now()

    def on_air(self, message: Temperature) -> None:
        """Take the reference logger's air temperature."""
        self._air = (self._now(), float(message.temperature))

    def on_device(self, message: Temperature) -> None:
        """Take the reference logger's thermocouple."""
        self._device = (self._now(), float(message.temperature))

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        """Take the recorder's status."""
        tasks = [
            status
            for status in message.status
            if node_of(status.name).rpartition('/')[2] == self._config.recorder
        ]
        errors = [task.message for task in tasks if _level(task) == ERROR_LEVEL]
        if tasks:
            self._recorder_error = '; '.join(errors)

    def readings(self) -> ExternalReadings:
        """Return the readings now, with what is missing or failed as `fault`."""
        referenced = not self._config.publish_temperature
        air, device = self._fresh(self._air), self._fresh(self._device)
        fault = f'recorder: {self._recorder_error}' if self._recorder_error else ''
        if referenced and air is None:
            fault = f'no chamber/temperature from the reference logger for {SILENCE_TIMEOUT_S:g} s'
        imu_alive = self._age(self._imu_stamp) <= SILENCE_TIMEOUT_S
        return ExternalReadings(
            imu_alive=imu_alive or not self._config.require_imu,
            fault=fault,
            air=air,
            device=device,
            referenced=referenced,
        )

    def _fresh(self, reading: tuple[int, float] | None) -> float | None:
        return reading[1] if reading and self._age(reading[0]) <= SILENCE_TIMEOUT_S else None

    def _age(self, stamp: int) -> float:
        return (self._now() - stamp) * 1e-9


def _level(status: Any) -> int:
    return int(status.level[0] if isinstance(status.level, bytes) else status.level)
