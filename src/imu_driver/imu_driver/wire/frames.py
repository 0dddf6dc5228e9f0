# SPDX-License-Identifier: Apache-2.0
"""Frames of the wire protocol as values: data, information, acknowledgement and command.

Their bytes are the business of `ascii` and `binary`; doc/wire_protocol.md is the specification.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple, TypeAlias

PROTOCOL_VERSION: Final = 1
"""The only version this driver speaks."""

MAGNETOMETER_NEW: Final = 0x1
"""Flag: the magnetometer counts were measured at this frame's tick."""
TEMPERATURE_NEW: Final = 0x2
"""Flag: the temperature count was measured at this frame's tick."""
CONFIGURATION_SHIFT: Final = 2
"""Flags bits 2–3: number of changes of full scale or rate since power-on, modulo 4."""

STREAMING: Final = 0x1
"""Information flag: data frames are being sent."""


REGISTER_DUMP_BYTES: Final = 16
"""Bytes of the register dump in an information frame; board.lsm9ds1.REGISTERS names them."""


class DataFrame(NamedTuple):
    """One sample as raw counts."""

    sequence: int
    """0 … 65535, counts every sample made since power-on, sent or not."""
    tick: int
    """Device clock at the sample [ticks of 1 µs], modulo 2³²."""
    flags: int
    """MAGNETOMETER_NEW | TEMPERATURE_NEW | configuration << CONFIGURATION_SHIFT."""
    temperature: int
    """Count."""
    counts: tuple[int, ...]
    """(9,) gyroscope x y z, accelerometer x y z, magnetometer x y z; chip axes."""

    @property
    def configuration(self) -> int:
        """Number of the configuration the counts were measured in, 0 … 3."""
        return self.flags >> CONFIGURATION_SHIFT


@dataclass(frozen=True)
class InformationFrame:
    """Identity, settings and counters of the device."""

    serial_number: str
    """1 … 16 printable ASCII characters without comma and asterisk."""
    streaming: bool
    configuration: int
    """As in the data frames' flags: the full scales below belong to this value."""
    tick: int
    samples: int
    """Samples made since power-on: the sequence number of the next, in 32 bits."""
    firmware: tuple[int, int, int]
    tick_rate: int
    """Nominal ticks per second."""
    full_scale: tuple[int, int, int]
    """Gyroscope [dps], accelerometer [g], magnetometer [gauss]."""
    output_data_rate: int
    """Gyroscope and accelerometer [mHz]."""
    magnetometer_rate: int
    """[mHz]."""
    i2c_errors: int
    overruns: int
    """Samples made but not sent since power-on, for want of room in the output buffer."""
    command_errors: int
    """Frames from the host that failed their check, since power-on."""
    supply_millivolts: int
    """0 where the board does not measure it."""
    who_am_i: tuple[int, int]
    """Accelerometer and gyroscope, magnetometer."""
    registers: tuple[int, ...]
    """(REGISTER_DUMP_BYTES,) read back from the device, in the order of lsm9ds1.REGISTERS."""
    version: int = PROTOCOL_VERSION


class CommandCode(IntEnum):
    """Commands of the host, and the unit of the command's value."""

    INFORMATION = 1
    START = 2
    STOP = 3
    GYROSCOPE_FULL_SCALE = 4  # dps
    ACCELEROMETER_FULL_SCALE = 5  # g
    MAGNETOMETER_FULL_SCALE = 6  # gauss
    OUTPUT_DATA_RATE = 7  # mHz


class Status(IntEnum):
    """Result of a command."""

    DONE = 0
    UNKNOWN_COMMAND = 1
    BAD_VALUE = 2
    DEVICE_ERROR = 3


class CommandFrame(NamedTuple):
    """One command of the host."""

    command: int
    number: int
    """0 … 255, chosen by the host, repeated in the acknowledgement."""
    value: int = 0


class AcknowledgementFrame(NamedTuple):
    """Answer to one command."""

    command: int
    number: int
    status: int
    value: int
    """The value now in force."""


class OtherVersion(NamedTuple):
    """An information frame of a protocol version other than PROTOCOL_VERSION."""

    version: int


Frame: TypeAlias = (
    DataFrame | InformationFrame | AcknowledgementFrame | CommandFrame | OtherVersion
)


class FrameError(ValueError):
    """Bytes that are no valid frame; `kind` is 'cobs', 'crc' or 'format'."""

    def __init__(self, kind: str) -> None:
        super().__init__(f'{kind} error')
        self.kind = kind


def is_serial_number(text: bytes) -> bool:
    """Whether the bytes may be a serial number: 1 … 16 printable characters, no comma, no `*`."""
    return 1 <= len(text) <= 16 and all(0x20 < c < 0x7F and c not in b',*$' for c in text)
