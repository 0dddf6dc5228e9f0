# SPDX-License-Identifier: Apache-2.0
"""Status of a running driver once a second: level, one line, and the numbers behind it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Final

from imu_driver.board.lsm9ds1 import OPERATING_TEMPERATURE, REGISTERS, SUPPLY_VOLTAGE
from imu_driver.board.reader import DeviceReader
from imu_driver.board.session import DeviceSession
from imu_driver.board.stream_statistics import StreamStatistics
from imu_driver.driver_config import DriverParameters
from imu_driver.sample_queue import SampleQueue
from imu_driver.wire.frames import InformationFrame

OK, WARN, ERROR = 0, 1, 2

RATE_TOLERANCE: Final = 0.05
"""Relative; wider than the output data rate's spread over devices and temperature."""
STALE: Final = 1.0
"""[s] without data is an error."""
MUCH: Final = 1000
"""[bytes] In so many there must be a frame."""
REMEMBERED: Final = 10
"""Calls for which something counted keeps the level at WARN."""


class Diagnosis:
    """Watches one driver."""

    def __init__(
        self,
        statistics: StreamStatistics,
        queue: SampleQueue,
        parameters: DriverParameters,
        session: DeviceSession | None = None,
        reader: DeviceReader | None = None,
        *,
        is_over: Callable[[], bool] | None = None,
    ) -> None:
        self._statistics = statistics
        self._queue = queue
        self._parameters = parameters
        self._session = session
        self._reader = reader
        self._is_over = is_over
        self._past: deque[dict[str, int]] = deque(maxlen=REMEMBERED)

    def take(self, now: int) -> tuple[int, str, dict[str, Any]]:
        """Return level, line and values at ROS time `now` [ns]."""
        rate, jitter = self._statistics.take_rate()
        values: dict[str, Any] = {
            'transport': self._parameters.transport,
            'rate_hz': rate,
            'jitter_ms': jitter * 1e3,
            'published': self._statistics.published,
            'temperature_c': self._statistics.temperature,
            'buffer_fill': self._queue.fill,
            'buffer_fullest': self._queue.fullest,
            'buffer_overflowed': self._queue.overflowed,
        }
        if self._session is None or self._reader is None:
            ended = self._is_over is not None and self._is_over()
            return OK, 'the bag has ended' if ended else 'replaying', values
        session, reader = self._session, self._reader
        counted = self._counted(session, reader)
        since = self._past[0] if self._past else counted
        recent = {key: counted[key] - since[key] for key in counted if counted[key] > since[key]}
        self._past.append(counted)
        values |= counted
        values |= {
            'protocol': session.decoder.protocol,
            'nominal_rate_hz': session.nominal_rate,
            'samples_received': session.sequence.received,
            'bytes': session.counts.bytes,
            'tick_wraps': session.clock.wraps,
            'clock_skew_ppm': session.clock.skew_ppm,
            'clock_residual_us': session.clock.residual * 1e6,
        }
        if session.sequence.missing:
            gap = session.sequence.missing[-1]
            values['last_gap'] = f'{gap.start} … {gap.stop - 1}'
        if session.information:
            values |= _identity(session.information)
        errors = self._errors(session, reader, now)
        warnings = self._warnings(session, rate)
        if recent:
            told = ', '.join(f'{number} {key}' for key, number in recent.items())
            warnings.append(f'in the last {REMEMBERED} s: {told}')
        if errors:
            return ERROR, '; '.join(errors + warnings), values
        if warnings:
            return WARN, '; '.join(warnings), values
        return OK, f'{rate:.1f} Hz', values

    def _counted(self, session: DeviceSession, reader: DeviceReader) -> dict[str, int]:
        counts = session.counts
        return {
            'samples_lost': session.sequence.lost,
            'sequence_gaps': session.sequence.gaps,
            'samples_discarded': session.discarded,
            'duplicates': session.duplicates,
            'crc_errors': counts.crc,
            'cobs_errors': counts.cobs,
            'format_errors': counts.format,
            'reconnects': reader.reconnects,
            'device_restarts': session.restarts,
            'device_exchanges': session.exchanges,
            'configuration_changes': session.configuration_changes,
            'host_clock_steps': session.clock.steps,
        }

    def _errors(self, session: DeviceSession, reader: DeviceReader, now: int) -> list[str]:
        errors = []
        if not (reader.running and self._queue.running):
            errors.append('the driver has stopped after an internal error: see its log')
        elif not reader.connected:
            errors.append(f'not connected: {reader.trouble}')
        elif session.refusal:
            errors.append(f'refused: {session.refusal}')
        elif session.counts.bytes > MUCH and not session.counts.frames:
            errors.append('bytes come, but no frame among them: check baudrate and protocol')
        elif now - session.last_data > STALE * 1e9:
            errors.append('no data' if session.last_data else 'no data yet')
        return errors

    def _warnings(self, session: DeviceSession, rate: float) -> list[str]:
        warnings = list(session.set_up.refused.values())
        nominal = session.nominal_rate
        if nominal and rate and abs(rate / nominal - 1.0) > RATE_TOLERANCE:
            warnings.append(f'rate is {rate:.1f} Hz, nominal {nominal:.1f} Hz')
        temperature = self._statistics.temperature
        low, high = OPERATING_TEMPERATURE
        if not (low <= temperature <= high or temperature != temperature):  # noqa: PLR0124 (NaN)
            warnings.append(f'die at {temperature:.1f} °C, rated {low:g} … {high:g} °C')
        information = session.information
        if information:
            supply = information.supply_millivolts * 1e-3
            low, high = SUPPLY_VOLTAGE
            if supply and not low <= supply <= high:
                warnings.append(f'supply {supply:.2f} V, rated {low:g} … {high:g} V')
            if information.magnetometer_temperature_compensation:
                warnings.append('the magnetometer compensates its temperature error by itself')
        return warnings


def _identity(information: InformationFrame) -> dict[str, Any]:
    gyroscope, accelerometer, magnetometer = information.full_scale
    return {
        'device': information.serial_number,
        'firmware': '.'.join(map(str, information.firmware)),
        'gyroscope_full_scale_dps': gyroscope,
        'accelerometer_full_scale_g': accelerometer,
        'magnetometer_full_scale_gauss': magnetometer,
        'magnetometer_rate_hz': information.magnetometer_rate / 1e3,
        'magnetometer_temperature_compensation': (
            information.magnetometer_temperature_compensation
        ),
        'supply_v': information.supply_millivolts / 1e3,
        'device_i2c_errors': information.i2c_errors,
        'device_overruns': information.overruns,
        'device_command_errors': information.command_errors,
        'who_am_i': bytes(information.who_am_i).hex(),
        'registers': ' '.join(
            f'{name}={value:02x}'
            for name, value in zip(REGISTERS, information.registers, strict=True)
        ),
    }
