# SPDX-License-Identifier: Apache-2.0
"""The driver's side of the conversation with one device, sans-I/O: bytes in, stamped samples out.

The session identifies the device, sets it up, starts it, follows restarts and exchanges, and
accounts for every sample. A data frame waits until the device has reported its full scales.

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

from imu_recording.recording import SECOND_NS

from imu_driver.board.clock import DeviceClock, Observation
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

MOST_HELD_FRAMES: Final = 4000
"""Frames kept while their scale is unknown (four seconds at the highest rate)."""
SETTLING_TIME_S: Final = 0.2
"""[s] of samples collected before the first is stamped: a stall at the start does not spoil it."""
SILENT_BOARD_TIMEOUT_S: Final = 1.5
"""[s] after which an ASCII board that sends no information is read with assumed full scales."""
MOST_REMEMBERED_GAPS: Final = 1000


class WarningEvent(str):
    """An event to be logged as a warning; other events are plain text, logged as information."""

    __slots__ = ()


@dataclass(frozen=True)
class SessionConfig:
    """Settings wanted of the device."""

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
        """Why the device's data are not published; '' where they are."""
        self.events: list[str] = []
        """Messages for the operator, in order; the caller takes and clears them."""
        self.discarded = 0
        """Samples received, not published: device refused, or its full scales never reported."""
        self.duplicates = 0
        self.restarts = 0
        self.exchanges = 0
        self.configuration_changes = 0
        self.last_data = 0
        """ROS time of the last data frame's arrival [ns]; 0 before the first."""
        self._past = DecoderCounts()
        self._stamped: list[Sample] = []
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
        """Keep the counts of the connection that ended; return its last samples."""
        self._stamp()
        self._past = self.counts
        self.decoder = FrameDecoder(self.config.protocol)
        self._discard(len(self._held))
        return self._take_stamped()

    @property
    def counts(self) -> DecoderCounts:
        """Bytes, frames and errors over all connections."""
        return self._past + self.decoder.counts

    @property
    def nominal_rate(self) -> float:
        """Output data rate the device reports [Hz]; 0 unknown."""
        return self.information.output_data_rate / 1e3 if self.information else 0.0

    # Traffic ----------------------------------------------------------------------------------

    def feed(self, chunk: bytes, arrival: int) -> list[Sample]:
        """Return the samples that a chunk completes; `arrival` is its ROS time [ns]."""
        for frame in self.decoder.feed(chunk):
            if isinstance(frame, DataFrame):
                self._on_data(frame, arrival)
            else:
                self._on_frame(frame, arrival)
        if self.clock.age >= SETTLING_TIME_S:
            self._stamp()
        return self._take_stamped()

    def outgoing(self, now: int) -> bytes:
        """Return the bytes to send to the device at ROS time `now` [ns], often none."""
        return self.set_up.outgoing(now, self.decoder.protocol, known=self._scale is not None)

    def ask(self, now: int) -> None:
        """Ask the device for information soon."""
        self.set_up.ask(now)

    def command(self, code: CommandCode, value: int = 0) -> None:
        """Send a command as soon as the line is free."""
        self.set_up.request(code, value)

    def _on_frame(self, frame: Frame, arrival: int) -> None:
        if isinstance(frame, InformationFrame):
            self._on_information(frame, arrival)
        elif isinstance(frame, AcknowledgementFrame):
            refused = self.set_up.acknowledged(frame)
            if refused:
                self.events.append(WarningEvent(refused))
        elif isinstance(frame, OtherVersion):
            self._stamp()
            self._refuse(f'the device speaks protocol version {frame.version}, this driver 1')

    # Data -------------------------------------------------------------------------------------

    def _on_data(self, frame: DataFrame, arrival: int) -> None:
        if (frame.sequence, frame.tick) == self._last:
            self.duplicates += 1
            return
        self._last = (frame.sequence, frame.tick)
        self.last_data = arrival
        if self.refusal:
            self.sequence.take(frame.sequence)
            self.discarded += 1
        elif self._scale is not None and frame.configuration == self._configuration:
            self._observe(frame, arrival)
        else:
            self._hold(frame, arrival)

    def _observe(self, frame: DataFrame, arrival: int) -> None:
        """Count a frame whose scale is known and show it to the clock; `_stamp` follows."""
        if self.clock.has_restarted(frame.tick, arrival):
            self._stamp()
            self._restarted()
        if self._scale is None:
            self._held.append((frame, arrival))
            return
        self.sequence.take(frame.sequence)
        self._unstamped.append((frame, self.clock.observe(frame.tick, arrival)))

    def _stamp(self) -> None:
        """Turn the frames observed since the last call into stamped samples."""
        if not self._unstamped or self._scale is None:
            return
        stamps = self.clock.settle([observation for _, observation in self._unstamped])
        for stamp, (frame, _) in zip(stamps, self._unstamped, strict=True):
            self._stamped.append(self._scale.sample(stamp, frame))
        self._unstamped.clear()

    def _take_stamped(self) -> list[Sample]:
        samples, self._stamped = self._stamped, []
        return samples

    def _hold(self, frame: DataFrame, arrival: int) -> None:
        """Keep a frame until the device has reported the full scales of its configuration."""
        if self._scale is not None:
            self._stamp()
            self._scale = None
            self.set_up.ask(arrival)
        self._held.append((frame, arrival))
        if len(self._held) > MOST_HELD_FRAMES:
            self._discard(1)
        waited = arrival - self._held[0][1]
        is_silent = not self._identified and self.decoder.protocol == 'ascii'
        if is_silent and waited > SILENT_BOARD_TIMEOUT_S * SECOND_NS:
            self._accept_silent_board()

    def _accept_silent_board(self) -> None:
        """Read a board that sends no information with the full scales wanted, or its default."""
        if self.config.device:
            self._refuse(f'the device sends no serial number, {self.config.device} is wanted')
            return
        full_scale = {**DEFAULT_FULL_SCALE, **self.config.full_scale}
        assumed = ', '.join(f'{sensor} {full_scale[sensor]:g}' for sensor in SENSORS)
        self.events.append(f'the device sends no information: full scales assumed: {assumed}')
        self.set_up.give_up()
        self._identified = True
        self._set_scale(full_scale, self._held[-1][0].configuration)

    def _set_scale(self, full_scale: Mapping[str, float], configuration: int) -> None:
        """Take over the full scales of a configuration and go through the frames held for it."""
        self._scale = SampleScale(full_scale, self.config.axis_maps)
        self._configuration = configuration
        held, self._held = self._held, []
        for frame, arrival in held:
            if frame.configuration == configuration:
                self._observe(frame, arrival)
            else:
                self.sequence.take(frame.sequence)
                self.discarded += 1

    # Information ------------------------------------------------------------------------------

    def _on_information(self, frame: InformationFrame, arrival: int) -> None:
        self._stamp()
        self._note_changes(frame, arrival)
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
            self._set_scale(full_scale, frame.configuration)
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

    def _note_changes(self, frame: InformationFrame, arrival: int) -> None:
        """Notice another device, a restart or other full scales."""
        before = self.information
        if before is None:
            version = '.'.join(map(str, frame.firmware))
            self.events.append(f'device {frame.serial_number}, firmware {version}')
        elif before.serial_number != frame.serial_number:
            self.exchanges += 1
            event = f'device {frame.serial_number} took the place of {before.serial_number}'
            self.events.append(WarningEvent(event))
            self.clock.restart()
            self.sequence.restart(None)
        elif self.sequence.has_restarted(frame.samples) or self.clock.has_restarted(
            frame.tick, arrival
        ):
            self._restarted()
        elif before.full_scale != frame.full_scale:
            self.configuration_changes += 1
            old, new = (', '.join(map(str, f.full_scale)) for f in (before, frame))
            event = f'full scales (dps, g, gauss) changed from {old} to {new}'
            self.events.append(WarningEvent(event))

    def _restarted(self) -> None:
        self.restarts += 1
        self.events.append(WarningEvent('the device restarted'))
        self.clock.restart()
        self.sequence.restart(0)
        self.set_up.stopped()
        self._scale = None

    def _refuse(self, reason: str) -> None:
        if reason != self.refusal:
            self.events.append(WarningEvent(f'refused: {reason}'))
        self.refusal = reason
        self._discard(len(self._held))

    def _discard(self, count: int) -> None:
        for frame, _ in self._held[:count]:
            self.sequence.take(frame.sequence)
        del self._held[:count]
        self.discarded += count


_RANGE_16 = 0xFFFF
_RANGE_32 = 0xFFFFFFFF


@dataclass
class SequenceCount:
    """Counts received and lost samples by sequence numbers of 16 bits, extended to 32."""

    received: int = 0
    lost: int = 0
    gaps: int = 0
    following: int | None = None
    """Number the next sample will have; None before the first."""
    missing: deque[range] = field(default_factory=lambda: deque(maxlen=MOST_REMEMBERED_GAPS))
    """Numbers of lost samples, a range per gap; the newest MOST_REMEMBERED_GAPS gaps."""
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
        """Take over the device's own count of samples made; return how many it shows to be lost.

        It comes in its place in the stream: a sample counted before it has arrived or is lost.
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
