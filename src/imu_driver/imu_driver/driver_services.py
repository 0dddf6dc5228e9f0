# SPDX-License-Identifier: Apache-2.0
"""What the driver answers to the services ~/restart_stream, ~/measure_rest, ~/check_position."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from imu_driver.driver import ImuDriver
from imu_driver.frames import CommandCode
from imu_driver.rest_report import PositionCheck, rest_report
from imu_driver.stream_statistics import RestError


class DriverServices:
    """Callbacks for std_srvs/Trigger; `driver()` returns the running driver, if there is one."""

    def __init__(self, driver: Callable[[], ImuDriver | None]) -> None:
        self._driver = driver
        self._positions = PositionCheck()
        self.callbacks = {
            'restart_stream': self.restart_stream,
            'measure_rest': self.measure_rest,
            'check_position': self.check_position,
        }

    def restart_stream(self, _: Any, response: Any) -> Any:
        """Stop and start the device's stream."""
        return self._answer(response, _restart)

    def measure_rest(self, _: Any, response: Any) -> Any:
        """Tell gyroscope bias and noise over the last seconds."""
        return self._answer(response, lambda driver: rest_report(driver.statistics))

    def check_position(self, _: Any, response: Any) -> Any:
        """Take the present position into the six-position check."""
        return self._answer(response, lambda driver: self._positions.take(driver.statistics))

    def _answer(self, response: Any, ask: Callable[[ImuDriver], str]) -> Any:
        driver = self._driver()
        try:
            response.message = ask(driver) if driver else 'no device is being read'
            response.success = driver is not None
        except RestError as error:
            response.success, response.message = False, str(error)
        return response


def _restart(driver: ImuDriver) -> str:
    if driver.session is None:
        raise RestError('a bag has no stream to restart')
    driver.session.command(CommandCode.STOP)
    driver.session.command(CommandCode.START)
    return 'restarting'
