# SPDX-License-Identifier: Apache-2.0
"""What others report about a run: the IMU (alive?), the reference logger, the recorder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Temperature

from chamber_profile.run.conductor import Surroundings

if TYPE_CHECKING:
    from chamber_profile.run.config import ChamberConfig

SILENCE_S = 10.0
"""Who says nothing for so long is dead [s]."""
ERROR = 2


class Witnesses:
    """Keeps the newest word of each; `look` sums them up."""

    def __init__(self, config: ChamberConfig, now: Callable[[], int]) -> None:
        self._config = config
        self._now = now
        self._imu_at = now()
        self._air: tuple[int, float] | None = None
        self._device: tuple[int, float] | None = None
        self._recorder = ''

    def inputs(self) -> Iterator[tuple[type, str, Callable[[Any], None]]]:
        """Yield type, topic and callback of everything to listen to."""
        for topic in self._config.imu_topics if self._config.require_imu else []:
            yield Temperature, topic, self.on_imu
        if not self._config.publish_temperature:
            yield Temperature, 'chamber/temperature', self.on_air
            yield Temperature, 'chamber/device_temperature', self.on_device
        yield DiagnosticArray, '/diagnostics', self.on_diagnostics

    def excuse_imu(self) -> None:
        """Give the IMU ten seconds from now."""
        self._imu_at = self._now()

    def on_imu(self, _: Any) -> None:
        """Take a sign of life."""
        self._imu_at = self._now()

    def on_air(self, message: Any) -> None:
        """Take the reference logger's air temperature."""
        self._air = (self._now(), float(message.temperature))

    def on_device(self, message: Any) -> None:
        """Take the reference logger's thermocouple."""
        self._device = (self._now(), float(message.temperature))

    def on_diagnostics(self, message: Any) -> None:
        """Take the recorder's complaints."""
        for status in message.status:
            if status.name.rpartition('/')[2] == self._config.recorder:
                level = status.level[0] if isinstance(status.level, bytes) else status.level
                self._recorder = status.message if level == ERROR else ''

    def look(self) -> Surroundings:
        """Return how things stand."""
        referenced = not self._config.publish_temperature
        air, device = self._fresh(self._air), self._fresh(self._device)
        fault = f'recorder: {self._recorder}' if self._recorder else ''
        if referenced and air is None:
            fault = f'no chamber/temperature from the reference logger for {SILENCE_S:g} s'
        return Surroundings(
            imu_alive=not self._config.require_imu or self._age(self._imu_at) <= SILENCE_S,
            fault=fault,
            air=air,
            device=device,
            referenced=referenced,
        )

    def _fresh(self, reading: tuple[int, float] | None) -> float | None:
        return reading[1] if reading and self._age(reading[0]) <= SILENCE_S else None

    def _age(self, stamp: int) -> float:
        return (self._now() - stamp) * 1e-9
