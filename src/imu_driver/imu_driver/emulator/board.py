# SPDX-License-Identifier: Apache-2.0
"""An emulated board, sans-I/O: the frames it sends until a given time, and its answers.

It follows doc/wire_protocol.md as firmware would; the counts come from a simulated device.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol

from imu_driver.board import lsm9ds1
from imu_driver.wire.codec import FrameDecoder, encode
from imu_driver.wire.frames import (
    CONFIGURATION_SHIFT,
    MAGNETOMETER_NEW,
    TEMPERATURE_NEW,
    AcknowledgementFrame,
    CommandCode,
    CommandFrame,
    DataFrame,
    Frame,
    InformationFrame,
    Status,
)

INFORMATION_INTERVAL_S: Final = 1.0
"""[s] between information frames."""
MAGNETOMETER_RATE_HZ: Final = 80.0
"""[Hz]."""
SENSOR_OF_COMMAND: Final = {
    CommandCode.GYROSCOPE_FULL_SCALE: 'gyroscope',
    CommandCode.ACCELEROMETER_FULL_SCALE: 'accelerometer',
    CommandCode.MAGNETOMETER_FULL_SCALE: 'magnetometer',
}


class CountSource(Protocol):
    """A device that measures: counts of gyroscope, accelerometer, magnetometer, temperature."""

    full_scale: dict[str, float]

    @property
    def rate_factor(self) -> float:
        """Actual over nominal output data rate after the last sample."""

    def sample(
        self, time: float, ambient: float
    ) -> tuple[Sequence[int], Sequence[int], Sequence[int], int]:
        """Return the counts at `time` [s] and the ambient temperature `ambient` [°C]."""


@dataclass(frozen=True)
class BoardOptions:
    """Properties of the board: its parts and its firmware."""

    protocol: str = 'binary'
    serial_number: str = 'DUT1'
    output_data_rate: float = 238.0
    """[Hz] after power-on."""
    tick_skew: float = 20e-6
    """How much faster than true time the board's crystal runs."""
    first_tick: int = 0
    """Reading of the tick counter at time 0."""
    magnetometer_temperature_compensation: bool = False
    minimal: bool = False
    """Sends data from power-on, no information, and takes no commands, as a minimal sketch."""
    version: int = 1
    """Protocol version in its information frames."""


class Sent(NamedTuple):
    """One frame's bytes; `sample` numbers it in 32 bits if it is a data frame, else −1."""

    data: bytes
    sample: int


class EmulatedBoard:
    """A board with power since `time` 0 [s]."""

    def __init__(
        self,
        source: CountSource,
        options: BoardOptions | None = None,
        *,
        ambient: Callable[[float], float] = lambda _: 20.0,
        device_time: Callable[[float], float] = lambda time: time,
    ) -> None:
        self.options = options or BoardOptions()
        self.samples = 0
        self.overruns = 0
        self.streaming = self.options.minimal
        self.configuration = 0
        self.output_data_rate = self.options.output_data_rate
        self.rate_error = 1.0
        """Actual over nominal rate, on top of the sensor's own error."""
        self._source = source
        self._ambient = ambient
        self._device_time = device_time
        self._decoder = FrameDecoder(self.options.protocol)
        self._replies: list[Frame] = []
        self._next_sample = 0.0
        self._next_information = 0.0
        self._powered_at = 0.0
        self._ticks_at_power = self.options.first_tick
        self._magnetometer_turn = -1
        self._temperature_turn = -1
        self._magnetic: tuple[int, ...] = (0, 0, 0)
        self._temperature = 0

    # Power and configuration ------------------------------------------------------------------

    def restart(self, time: float, serial_number: str | None = None) -> None:
        """Restart at `time` [s], as another board where a serial number is given."""
        if serial_number:
            self.options = replace(self.options, serial_number=serial_number)
        self.samples = 0
        self.overruns = 0
        self.streaming = self.options.minimal
        self.configuration = 0
        self.output_data_rate = self.options.output_data_rate
        self._source.full_scale = dict(lsm9ds1.DEFAULT_FULL_SCALE)
        self._replies.clear()
        self._next_sample = time
        self._next_information = time
        self._powered_at = time
        self._ticks_at_power = 0

    def set_full_scale(self, sensor: str, full_scale: float) -> None:
        """Measure with another full scale from the next sample on."""
        self._source.full_scale = {**self._source.full_scale, sensor: full_scale}
        self._changed()

    @property
    def full_scale(self) -> dict[str, float]:
        """Full scales in force, in datasheet units."""
        return dict(self._source.full_scale)

    def tick(self, time: float) -> int:
        """Return the tick counter at `time` [s]."""
        since = (time - self._powered_at) * (1.0 + self.options.tick_skew)
        return (self._ticks_at_power + round(since * 1e6)) & 0xFFFFFFFF

    @property
    def next_due(self) -> float:
        """Time [s] at which `advance` has something to do again."""
        if not self.streaming:
            return self._next_information
        return min(self._next_sample, self._next_information)

    # Traffic ----------------------------------------------------------------------------------

    def advance(self, time: float) -> list[Sent]:
        """Return the frames due until `time` [s], in order."""
        sent = [self._sent(frame) for frame in self._replies]
        self._replies.clear()
        while self.next_due <= time:
            if self.streaming and self._next_sample <= self._next_information:
                sent.append(self._measured(self._next_sample))
                rate = self.output_data_rate * self._source.rate_factor * self.rate_error
                self._next_sample += 1.0 / rate
            else:
                if not self.options.minimal:
                    sent.append(self._sent(self.information(self._next_information)))
                self._next_information += INFORMATION_INTERVAL_S
        return sent

    def receive(self, chunk: bytes, time: float) -> None:
        """Take bytes from the host at `time` [s]; answers come with the next `advance`."""
        if self.options.minimal:
            return
        for frame in self._decoder.feed(chunk):
            if isinstance(frame, CommandFrame):
                status, value = self._obey(frame, time)
                if frame.number:
                    self._replies.append(
                        AcknowledgementFrame(
                            command=frame.command, number=frame.number, status=status, value=value
                        )
                    )
                self._replies.append(self.information(time))

    def final_information(self, time: float) -> Sent:
        """Return an information frame outside the interval, for the end of a run."""
        return self._sent(self.information(time))

    def information(self, time: float) -> InformationFrame:
        """Return the information frame of `time` [s]."""
        full_scale = self._source.full_scale
        registers = lsm9ds1.register_set_up(
            full_scale,
            lsm9ds1.nearest_rate(self.output_data_rate),
            magnetometer_temperature_compensation=(
                self.options.magnetometer_temperature_compensation
            ),
        )
        gyroscope, accelerometer, magnetometer = (
            round(full_scale[sensor]) for sensor in lsm9ds1.SENSORS
        )
        return InformationFrame(
            serial_number=self.options.serial_number,
            streaming=self.streaming,
            configuration=self.configuration,
            tick=self.tick(time),
            samples=self.samples,
            firmware=(1, 0, 0),
            tick_rate=1_000_000,
            full_scale=(gyroscope, accelerometer, magnetometer),
            output_data_rate=round(self.output_data_rate * 1e3),
            magnetometer_rate=round(MAGNETOMETER_RATE_HZ * 1e3),
            i2c_errors=0,
            overruns=self.overruns,
            command_errors=self._decoder.counts.errors,
            supply_millivolts=3300,
            who_am_i=(
                lsm9ds1.WHO_AM_I['accelerometer_gyroscope'],
                lsm9ds1.WHO_AM_I['magnetometer'],
            ),
            registers=tuple(registers[name] for name in lsm9ds1.REGISTERS),
            version=self.options.version,
        )

    def _obey(self, command: CommandFrame, time: float) -> tuple[Status, int]:
        code, value = command.command, command.value
        if code == CommandCode.INFORMATION:
            return Status.DONE, 0
        if code in (CommandCode.START, CommandCode.STOP):
            if code == CommandCode.START and not self.streaming:
                self._next_sample = time
            self.streaming = code == CommandCode.START
            return Status.DONE, 0
        if code == CommandCode.OUTPUT_DATA_RATE:
            if value / 1e3 not in lsm9ds1.OUTPUT_DATA_RATES:
                return Status.BAD_VALUE, round(self.output_data_rate * 1e3)
            self.output_data_rate = value / 1e3
            self._next_sample = time
            self._changed()
            return Status.DONE, value
        if code in SENSOR_OF_COMMAND:
            return self._set_full_scale(SENSOR_OF_COMMAND[CommandCode(code)], value)
        return Status.UNKNOWN_COMMAND, 0

    def _set_full_scale(self, sensor: str, value: int) -> tuple[Status, int]:
        in_force = self._source.full_scale[sensor]
        if float(value) not in lsm9ds1.SENSITIVITY[sensor]:
            return Status.BAD_VALUE, round(in_force)
        if value != in_force:
            self.set_full_scale(sensor, float(value))
        return Status.DONE, value

    def _changed(self) -> None:
        self.configuration = (self.configuration + 1) % 4

    def _measured(self, time: float) -> Sent:
        flags = self.configuration << CONFIGURATION_SHIFT
        gyroscope, accelerometer, magnetometer, temperature = self._source.sample(
            self._device_time(time), self._ambient(self._device_time(time))
        )
        turn = int(time * MAGNETOMETER_RATE_HZ)
        if turn != self._magnetometer_turn:
            self._magnetometer_turn = turn
            self._magnetic = tuple(int(count) for count in magnetometer)
            flags |= MAGNETOMETER_NEW
        turn = int(time * lsm9ds1.TEMPERATURE_RATE_HZ)
        if turn != self._temperature_turn:
            self._temperature_turn = turn
            self._temperature = int(temperature)
            flags |= TEMPERATURE_NEW
        counts = (*map(int, gyroscope), *map(int, accelerometer), *self._magnetic)
        sample = self.samples
        self.samples += 1
        frame = DataFrame(
            sequence=sample & 0xFFFF,
            tick=self.tick(time),
            flags=flags,
            temperature=self._temperature,
            counts=counts,
        )
        return self._sent(frame, sample)

    def _sent(self, frame: Frame, sample: int = -1) -> Sent:
        return Sent(encode(frame, self.options.protocol), sample)
