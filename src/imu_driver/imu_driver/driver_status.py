# SPDX-License-Identifier: Apache-2.0
"""Status of a running driver once a second: level, one line, and the numbers behind it."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

from imu_driver.board.lsm9ds1 import (
    OPERATING_TEMPERATURE_RANGE_C,
    REGISTERS,
    SUPPLY_VOLTAGE_RANGE_V,
    compensates_magnetometer_temperature,
)
from imu_driver.board.reader import DeviceReader
from imu_driver.board.session import DeviceSession
from imu_driver.driver import ImuDriver
from imu_driver.wire.frames import InformationFrame

OK, WARN, ERROR = 0, 1, 2

RATE_TOLERANCE: Final = 0.05
"""Relative; wider than the output data rate's spread over devices and temperature."""
DATA_TIMEOUT_S: Final = 1.0
"""[s] A longer time without data is an error."""
MOST_BYTES_WITHOUT_FRAME: Final = 1000
"""More bytes than this without one valid frame: baud rate or protocol are wrong."""
WARNING_CALLS: Final = 10
"""Number of calls, one a second, for which a counted event keeps the level at WARN."""


class DriverStatus:
    """Reports one driver's status; counted events are reported for WARNING_CALLS calls."""

    def __init__(self, driver: ImuDriver) -> None:
        self._driver = driver
        self._past: deque[dict[str, int]] = deque(maxlen=WARNING_CALLS)
        self._past_steps: deque[int] = deque(maxlen=WARNING_CALLS)

    def report(self, now: int) -> tuple[int, str, dict[str, Any]]:
        """Return level, line and values at ROS time `now` [ns]; call it once a second."""
        driver = self._driver
        rate, jitter = driver.statistics.take_rate()
        values: dict[str, Any] = {
            'transport': driver.parameters.transport,
            'rate_hz': rate,
            'jitter_ms': jitter * 1e3,
            'published': driver.statistics.published,
            'temperature_c': driver.statistics.temperature,
        }
        session, reader = driver.session, driver.device_reader
        if session is None or reader is None:
            values['device'] = driver.device
            return OK, 'the bag has ended' if driver.has_ended else 'replaying', values
        counted = _counted(session, reader)
        recent = self._recent(counted)
        values |= counted | _session_values(session)
        errors = _errors(session, reader, now)
        warnings = _warnings(session, rate, driver.statistics.temperature)
        if recent:
            counts = ', '.join(f'{number} {key}' for key, number in recent.items())
            warnings.append(f'in the last {WARNING_CALLS} s: {counts}')
        if errors:
            return ERROR, '; '.join(errors + warnings), values
        if warnings:
            return WARN, '; '.join(warnings), values
        return OK, f'{rate:.1f} Hz', values

    def clock(self, session: DeviceSession) -> tuple[int, str, dict[str, Any]]:
        """Return how well the device's clock is followed; call it once a second."""
        clock = session.clock
        before = self._past_steps[0] if self._past_steps else clock.steps
        self._past_steps.append(clock.steps)
        values: dict[str, Any] = {
            'tick_wraps': clock.wraps,
            'clock_skew_ppm': clock.skew_ppm,
            'clock_residual_us': clock.residual * 1e6,
            'host_clock_steps': clock.steps,
        }
        if clock.steps > before:
            jumps = f'the host clock stepped {clock.steps - before} times'
            return WARN, f'{jumps} in the last {WARNING_CALLS} s', values
        return OK, f'{clock.skew_ppm:.0f} ppm from the host clock', values

    def _recent(self, counted: dict[str, int]) -> dict[str, int]:
        """Return the counts that rose over the last WARNING_CALLS calls, by how much."""
        since = self._past[0] if self._past else counted
        self._past.append(counted)
        return {key: counted[key] - since[key] for key in counted if counted[key] > since[key]}


def _counted(session: DeviceSession, reader: DeviceReader) -> dict[str, int]:
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
    }


def _session_values(session: DeviceSession) -> dict[str, Any]:
    values: dict[str, Any] = {
        'protocol': session.decoder.protocol,
        'nominal_rate_hz': session.nominal_rate,
        'samples_received': session.sequence.received,
        'bytes': session.counts.bytes,
    }
    if session.sequence.missing:
        gap = session.sequence.missing[-1]
        values['last_gap'] = f'{gap.start} … {gap.stop - 1}'
    if session.information:
        values |= _identity(session.information)
    return values


def _errors(session: DeviceSession, reader: DeviceReader, now: int) -> list[str]:
    if not reader.running:
        return ['the driver has stopped after an internal error: see its log']
    if not reader.connected:
        return [f'not connected: {reader.connection_error}']
    if not now:
        return ['no samples without time: use_sim_time is set and nothing comes on /clock']
    if session.refusal:
        return [f'refused: {session.refusal}']
    if session.counts.bytes > MOST_BYTES_WITHOUT_FRAME and not session.counts.frames:
        return ['bytes come, but no frame among them: check baudrate and protocol']
    if now - session.last_data > DATA_TIMEOUT_S * 1e9:
        return ['no data' if session.last_data else 'no data yet']
    return []


def _warnings(session: DeviceSession, rate: float, temperature: float) -> list[str]:
    warnings = list(session.set_up.refused.values())
    nominal = session.nominal_rate
    if nominal and rate and abs(rate / nominal - 1.0) > RATE_TOLERANCE:
        warnings.append(f'rate is {rate:.1f} Hz, nominal {nominal:.1f} Hz')
    low, high = OPERATING_TEMPERATURE_RANGE_C
    if temperature < low or temperature > high:
        warnings.append(f'die at {temperature:.1f} °C, rated {low:g} … {high:g} °C')
    information = session.information
    if information:
        supply = information.supply_millivolts * 1e-3
        low, high = SUPPLY_VOLTAGE_RANGE_V
        if supply and not low <= supply <= high:
            warnings.append(f'supply {supply:.2f} V, rated {low:g} … {high:g} V')
        if compensates_magnetometer_temperature(information.registers):
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
        'magnetometer_temperature_compensation': compensates_magnetometer_temperature(
            information.registers
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
