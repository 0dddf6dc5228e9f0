# SPDX-License-Identifier: Apache-2.0
"""One running driver without ROS: a reader, a queue, statistics, and what it says of itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from imu_driver.board.reader import DeviceReader
from imu_driver.board.sample import Sample
from imu_driver.board.session import DeviceSession
from imu_driver.board.stream_statistics import StreamStatistics
from imu_driver.board.transport import transport_opener
from imu_driver.driver_config import DriverParameters, session_config
from imu_driver.driver_status import Diagnosis
from imu_driver.sample_queue import SampleQueue


class Reader(Protocol):
    """What delivers samples."""

    def start(self) -> None:
        """Begin."""

    def stop(self) -> None:
        """End."""


class ImuDriver:
    """Reads samples from where the parameters say and publishes them in order."""

    def __init__(
        self,
        parameters: DriverParameters,
        *,
        now: Callable[[], int],
        publish: Callable[[Sample], None],
        report: Callable[[str], None],
    ) -> None:
        self.statistics = StreamStatistics()
        self.session: DeviceSession | None = None
        self._publish = publish
        self.queue = SampleQueue(self._publish_batch)
        self._reader: Reader
        if parameters.transport.startswith('bag:'):
            from imu_driver.replay import BagReader  # only now: it brings the bag reader

            bag = self._reader = BagReader(
                parameters.transport, deliver=self.queue.put_when_room, report=report
            )
            self.diagnosis = Diagnosis(
                self.statistics, self.queue, parameters, is_over=lambda: bag.ended
            )
        else:
            self.session = DeviceSession(session_config(parameters))
            self._reader = DeviceReader(
                transport_opener(
                    parameters.transport, parameters.baudrate, parameters.output_data_rate
                ),
                self.session,
                now=now,
                deliver=self.queue.put,
                report=report,
            )
            self.diagnosis = Diagnosis(
                self.statistics, self.queue, parameters, self.session, self._reader
            )

    def start(self) -> None:
        """Begin to read and publish."""
        self.queue.start()
        self._reader.start()

    def stop(self) -> None:
        """Stop reading, publish what waits."""
        self._reader.stop()
        self.queue.stop()

    def diagnostics(self, now: int) -> tuple[int, str, dict[str, Any]]:
        """Return level, line and values at ROS time `now` [ns]; ask once a second."""
        return self.diagnosis.take(now)

    @property
    def supply_voltage(self) -> float:
        """Device supply [V]; 0 unknown."""
        information = self.session.information if self.session else None
        return information.supply_millivolts * 1e-3 if information else 0.0

    def _publish_batch(self, samples: list[Sample]) -> None:
        for sample in samples:
            self._publish(sample)
            self.statistics.add(sample)
