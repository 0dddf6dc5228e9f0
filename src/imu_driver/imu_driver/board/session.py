# SPDX-License-Identifier: Apache-2.0
"""The driver's side of the conversation with one device, sans-I/O.

Feed it what arrives and when; it returns stamped samples. Ask it what to send. It identifies the
device, sets it up, starts it, follows restarts and exchanges, and accounts for every sample.
Nothing is published whose scale is not known from the device itself.

>>> count = SequenceCount()
>>> count.take(65534), count.take(65535), count.take(1)
(0, 0, 1)
>>> count.expect(65546), count.lost
(8, 9)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from imu_driver.board.clock import NANOSECOND, DeviceClock, Observation
from imu_driver.board.lsm9ds1 import DEFAULT_FULL_SCALE, SENSORS
from imu_driver.board.sample import AxisMap, Sample, SampleScale
from imu_driver.board.set_up import DeviceSetUp
from imu_driver.wire.codec import DecoderCounts, FrameDecoder
from imu_driver.wire.frames import (
    AcknowledgementFrame,
    CommandCode,
    DataFrame,
    Frame,
    InformationFrame,
    OtherVersion,
)

HELD_AT_MOST: Final = 4000
"""Samples kept while their scale is unknown (four seconds at the highest rate)."""
SETTLING: Final = 0.2
"""[s] The first samples wait so long, that a stall at the start does not spoil their stamps."""
SILENT_BOARD: Final = 1.5
"""[s] An ASCII sketch that tells nothing about itself for so long is taken as it is."""


@dataclass(frozen=True)
class SessionConfig:
    """What is wanted of the device."""

    protocol: str = 'auto'
    device: str = ''
    """Serial number that is accepted; '' any."""
    full_scale: Mapping[str, float] = field(default_factory=dict)
    """Full scales to set, by sensor, in datasheet units; a sensor left out keeps its own."""
    output_data_rate: float = 0.0
    """[Hz] to set; 0 keeps the device's."""
    latency: float = 0.0
    """[s] from sample to arrival at the least."""
    axis_maps: Mapping[str, AxisMap] = field(default_factory=dict)


class DeviceSession:
    """One device over any number of connections."""

    def __init__(self, config: SessionConfig) -> None:
        self.config = config
        self.clock = DeviceClock(latency=config.latency)
        self.sequence = SequenceCount()
        self.information: InformationFrame | None = None
        self.refusal = ''
        """Why nothing is published although data may come; '' if nothing stands against it."""
        self.events: list[str] = []
        """What an operator should read, in order; the caller takes and clears them."""
        self.discarded = 0
        """Samples received and not published: refused device, or scale never told."""
        self.duplicates = 0
        self.restarts = 0
        self.exchanges = 0
        self.configuration_changes = 0
        self.last_data = 0
        """ROS time of the last data frame's arrival [ns]; 0 before the first."""
        self._past = DecoderCounts()
        self.connected(0)

    # Connection -------------------------------------------------------------------------------

    def connected(self, now: int) -> None:
        """Start over with a fresh connection; `now` is ROS time [ns]."""
        self.decoder = FrameDecoder(self.config.protocol)
        self.set_up = DeviceSetUp(self.config.full_scale, self.config.output_data_rate, now)
        self._scale: SampleScale | None = None
        self._configuration = -1
        self._held: list[tuple[DataFrame, int]] = []
        self._unstamped: list[tuple[DataFrame, Observation]] = []
        self._identified = False
        self._last = (-1, -1)

    def disconnected(self) -> list[Sample]:
        """Keep the counts of the connection that ended; return the samples that still waited."""
        samples: list[Sample] = []
        self._settle(samples)
        self._past = self.counts
        self.decoder = FrameDecoder(self.config.protocol)
        self._discard(len(self._held))
        return samples

    @property
    def counts(self) -> DecoderCounts:
        """Bytes, frames and errors over all connections."""
        return self._past + self.decoder.counts

    @property
    def nominal_rate(self) -> float:
        """Rate the device says it samples at [Hz]; 0 unknown."""
        return self.information.output_data_rate / 1e3 if self.information else 0.0

    # Traffic ----------------------------------------------------------------------------------

    def feed(self, chunk: bytes, arrival: int) -> list[Sample]:
        """Return the samples that a chunk completes; `arrival` is its ROS time [ns]."""
        samples: list[Sample] = []
        for frame in self.decoder.feed(chunk):
            self._take(frame, arrival, samples)
        if self.clock.age >= SETTLING:
            self._settle(samples)
        return samples

    def outgoing(self, now: int) -> bytes:
        """Return what to send to the device at ROS time `now` [ns]; often nothing."""
        return self.set_up.outgoing(now, self.decoder.protocol, known=self._scale is not None)

    def _take(self, frame: Frame, arrival: int, samples: list[Sample]) -> None:
        if isinstance(frame, DataFrame):
            self._take_data(frame, arrival, samples)
        elif isinstance(frame, InformationFrame):
            self._take_information(frame, arrival, samples)
        elif isinstance(frame, AcknowledgementFrame):
            refused = self.set_up.acknowledged(frame)
            if refused:
                self.events.append(Trouble(refused))
        elif isinstance(frame, OtherVersion):
            self._settle(samples)
            self._refuse(f'the device speaks protocol version {frame.version}, this driver 1')

    def _take_data(self, frame: DataFrame, arrival: int, samples: list[Sample]) -> None:
        if (frame.sequence, frame.tick) == self._last:
            self.duplicates += 1
            return
        self._last = (frame.sequence, frame.tick)
        self.last_data = arrival
        if self.refusal:
            self.sequence.take(frame.sequence)
            self.discarded += 1
        elif self._scale is not None and frame.configuration == self._configuration:
            self._process(frame, arrival, samples)
        else:
            self._hold(frame, arrival, samples)

    def _process(self, frame: DataFrame, arrival: int, samples: list[Sample]) -> None:
        if self.clock.has_restarted(frame.tick, arrival):
            self._settle(samples)
            self._restarted()
        if self._scale is None:
            self._held.append((frame, arrival))
            return
        self.sequence.take(frame.sequence)
        self._unstamped.append((frame, self.clock.observe(frame.tick, arrival)))

    def _settle(self, samples: list[Sample]) -> None:
        """Stamp what was observed since the last call."""
        if not self._unstamped or self._scale is None:
            return
        stamps = self.clock.settle([observation for _, observation in self._unstamped])
        for stamp, (frame, _) in zip(stamps, self._unstamped, strict=True):
            samples.append(self._scale.sample(stamp, frame))
        self._unstamped.clear()

    def _hold(self, frame: DataFrame, arrival: int, samples: list[Sample]) -> None:
        """Keep a frame until the device has told which full scales it was measured with."""
        if self._scale is not None:
            self._settle(samples)
            self._scale = None
            self.set_up.ask(arrival)
        self._held.append((frame, arrival))
        if len(self._held) > HELD_AT_MOST:
            self._discard(1)
        waited = arrival - self._held[0][1]
        tells_nothing = not self._identified and self.decoder.protocol == 'ascii'
        if tells_nothing and waited > SILENT_BOARD * NANOSECOND:
            self._accept_silent_board(samples)

    def _accept_silent_board(self, samples: list[Sample]) -> None:
        if self.config.device:
            self._refuse(
                f'the device does not tell its serial number, {self.config.device} is wanted'
            )
            return
        full_scale = {**DEFAULT_FULL_SCALE, **self.config.full_scale}
        told = ', '.join(f'{sensor} {full_scale[sensor]:g}' for sensor in SENSORS)
        self.events.append(f'the device tells nothing about itself: full scales taken: {told}')
        self.set_up.give_up()
        self._identified = True
        self._release(full_scale, self._held[-1][0].configuration, samples)

    def _take_information(
        self, frame: InformationFrame, arrival: int, samples: list[Sample]
    ) -> None:
        self._settle(samples)
        self._compare(frame, arrival)
        self.clock.tick_rate = float(frame.tick_rate or 1_000_000)
        self.information = frame
        self._identified = True
        full_scale = dict(zip(SENSORS, map(float, frame.full_scale), strict=True))
        reason = self._reason_against(frame, full_scale)
        if reason:
            self._refuse(reason)
        else:
            if self.refusal:
                self.events.append(f'device {frame.serial_number} is accepted')
            self.refusal = ''
            self._release(full_scale, frame.configuration, samples)
            self.set_up.informed(frame, arrival)
        self.sequence.expect(frame.samples)

    def _reason_against(self, frame: InformationFrame, full_scale: Mapping[str, float]) -> str:
        wanted = self.config.device
        if wanted and frame.serial_number != wanted:
            return f'device {frame.serial_number} is connected, {wanted} is wanted'
        try:
            SampleScale(full_scale)
        except ValueError as error:
            return str(error)
        return ''

    def _compare(self, frame: InformationFrame, arrival: int) -> None:
        """Notice another device, a restart or another configuration."""
        before = self.information
        if before is None:
            version = '.'.join(map(str, frame.firmware))
            self.events.append(f'device {frame.serial_number}, firmware {version}')
        elif before.serial_number != frame.serial_number:
            self.exchanges += 1
            self.events.append(
                Trouble(f'device {frame.serial_number} took the place of {before.serial_number}')
            )
            self.clock.restart()
            self.sequence.restart(None)
        elif self.sequence.has_restarted(frame.samples) or self.clock.has_restarted(
            frame.tick, arrival
        ):
            self._restarted()
        elif before.full_scale != frame.full_scale:
            self.configuration_changes += 1
            self.events.append(
                Trouble(
                    'full scales (dps, g, gauss) changed from '
                    f'{_listed(before.full_scale)} to {_listed(frame.full_scale)}'
                )
            )

    def _restarted(self) -> None:
        self.restarts += 1
        self.events.append(Trouble('the device restarted'))
        self.clock.restart()
        self.sequence.restart(0)
        self.set_up.stopped()
        self._scale = None

    def _release(
        self, full_scale: Mapping[str, float], configuration: int, samples: list[Sample]
    ) -> None:
        self._scale = SampleScale(full_scale, self.config.axis_maps)
        self._configuration = configuration
        held, self._held = self._held, []
        for frame, arrival in held:
            if frame.configuration == configuration:
                self._process(frame, arrival, samples)
            else:
                self.sequence.take(frame.sequence)
                self.discarded += 1

    def _refuse(self, reason: str) -> None:
        if reason != self.refusal:
            self.events.append(Trouble(f'refused: {reason}'))
        self.refusal = reason
        self._discard(len(self._held))

    def _discard(self, count: int) -> None:
        for frame, _ in self._held[:count]:
            self.sequence.take(frame.sequence)
        del self._held[:count]
        self.discarded += count

    def ask(self, now: int) -> None:
        """Ask the device for information soon."""
        self.set_up.ask(now)

    def command(self, code: CommandCode, value: int = 0) -> None:
        """Send a command as soon as the line is free."""
        self.set_up.request(code, value)


def _listed(values: tuple[int, ...]) -> str:
    return ', '.join(map(str, values))


REMEMBERED: Final = 1000
"""Gaps."""

_RANGE_16 = 0xFFFF
_RANGE_32 = 0xFFFFFFFF


@dataclass
class SequenceCount:
    """Accounts for every sample the device has made."""

    received: int = 0
    lost: int = 0
    gaps: int = 0
    following: int | None = None
    """Number the next sample will have; None before the first."""
    missing: deque[range] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    """Numbers of the samples lost last."""
    _knows_32_bits: bool = False

    def take(self, number: int) -> int:
        """Count a sample by its 16-bit number; return how many were lost before it."""
        if self.following is None:
            self.following = number
        missing = (number - self.following) & _RANGE_16
        self._skip(missing)
        self.following = (self.following + missing + 1) & _RANGE_32
        self.received += 1
        return missing

    def expect(self, samples: int) -> int:
        """Take over the device's own count of samples made; return how many that says are lost.

        The count comes in its place in the stream, so every sample before it has come or will
        never come.
        """
        missing = self.behind(samples)
        self._skip(missing)
        self.following = samples
        self._knows_32_bits = True
        return missing

    def behind(self, samples: int) -> int:
        """Return how far this count is behind the device's; at least 2³¹ where it is ahead."""
        if self.following is None:
            return 0
        return (samples - self.following) & (_RANGE_32 if self._knows_32_bits else _RANGE_16)

    def has_restarted(self, samples: int) -> bool:
        """Whether the device's count is behind this one."""
        return self._knows_32_bits and self.behind(samples) > _RANGE_32 // 2

    def restart(self, following: int | None) -> None:
        """The device counts anew, from `following` or from where it happens to be (None)."""
        self.following = following
        self._knows_32_bits = following is not None

    def _skip(self, missing: int) -> None:
        if missing:
            self.gaps += 1
            self.lost += missing
            first = self.following or 0
            self.missing.append(range(first, first + missing))


class Trouble(str):
    """An event that an operator should look at; other events are plain text."""

    __slots__ = ()
