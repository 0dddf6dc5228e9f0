# SPDX-License-Identifier: Apache-2.0
"""An emulated board inside the driver's process: simulated://dut1?temperature=20&seed=1.

Options: `temperature`, ambient: a number [°C], the path of a CSV `time_s,temperature_c`, or
`chamber`, the air that a chamber's node measures; `orientation` (+x … -z, which axis points up);
`seed`; `protocol` (binary, ascii); `time_scale`. Its bytes go through the same session as those
of a real board.
"""

from __future__ import annotations

import csv
import time
from bisect import bisect_right
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from imu_recording.recording import UP_AXES
from imu_recording.user_error import UserError

from imu_driver.board.lsm9ds1 import DEFAULT_FULL_SCALE
from imu_driver.board.transport import READ_TIMEOUT_S, url_options
from imu_driver.emulator.board import BoardOptions, EmulatedBoard
from imu_driver.emulator.chamber_air import follows_chamber

DEFAULT_RATE_HZ: Final = 238.0
"""[Hz] Output data rate after power-on."""
OPTIONS: Final = {
    'temperature': '20',
    'orientation': '+z',
    'seed': '1',
    'protocol': 'binary',
    'time_scale': '1',
}


class SimulatedTransport:
    """A line to an emulated board that keeps running between connections."""

    def __init__(
        self,
        board: EmulatedBoard,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._board = board
        self._now = now
        self._sleep = sleep
        self._start = now()

    @classmethod
    def from_url(
        cls, url: str, rate: float = 0.0, air: Callable[[float], float] | None = None
    ) -> SimulatedTransport:
        """Return the transport of an URL; raise UserError naming a wrong option or value.

        `air`: ambient temperature [°C] of a board in a chamber, as a function of time [s].
        """
        parts = urlsplit(url)
        options = OPTIONS | url_options(url, OPTIONS)
        orientation = options['orientation']
        if orientation.lstrip('+-') == orientation:
            orientation = f'+{orientation}'
        if orientation not in UP_AXES:
            raise UserError(f'{url}: orientation must be one of {", ".join(UP_AXES)}')
        if options['protocol'] not in {'ascii', 'binary'}:
            raise UserError(f'{url}: protocol must be ascii or binary')
        try:
            seed, scale = int(options['seed']), float(options['time_scale'])
        except ValueError:
            raise UserError(f'{url}: seed and time_scale must be numbers') from None
        board = emulated_board(
            parts.netloc,
            BoardOptions(
                protocol=options['protocol'],
                serial_number=parts.netloc.upper(),
                output_data_rate=rate or DEFAULT_RATE_HZ,
            ),
            ambient=(air if follows_chamber(url) else None) or ambient_law(options['temperature']),
            orientation=orientation,
            seed=seed,
            time_scale=scale,
        )
        return cls(board)

    def read(self) -> bytes:
        """Return the bytes due by now; wait for the next, at most READ_TIMEOUT_S."""
        wait = self._start + self._board.next_due - self._now()
        if wait > 0:
            self._sleep(min(wait, READ_TIMEOUT_S))
        return b''.join(sent.data for sent in self._board.advance(self._now() - self._start))

    def write(self, data: bytes) -> None:
        """Pass the host's bytes to the board."""
        self._board.receive(data, self._now() - self._start)

    def close(self) -> None:
        """Do nothing: the board keeps running between connections."""


def emulated_board(
    device: str,
    options: BoardOptions,
    *,
    ambient: Callable[[float], float] = lambda _: 20.0,
    orientation: str = '+z',
    seed: int = 1,
    time_scale: float = 1.0,
) -> EmulatedBoard:
    """Return a board that carries the simulated device `device` (dut1 …).

    `ambient`: ambient temperature [°C] as a function of time [s]; `time_scale`: factor by which
    ambient and board temperatures run faster than the samples.
    """
    from imu_driver.simulation.stream import SimulatedDevice

    full_scale = dict(DEFAULT_FULL_SCALE)
    # The first sample compiles the kernels: a device of its own, before the clock starts.
    SimulatedDevice(device, seed=seed, full_scale=full_scale).sample(0.0, ambient(0.0))
    source = SimulatedDevice(device, seed=seed, full_scale=full_scale, orientation=orientation)
    return EmulatedBoard(
        source,
        options,
        ambient=ambient,
        device_time=lambda time: time * time_scale,
    )


AMBIENT_COLUMNS = ('time_s', 'temperature_c')


class AmbientError(UserError):
    """A table of ambient temperature that cannot be read; the message names file and error."""


def ambient_law(text: str) -> Callable[[float], float]:
    """Return the temperature [°C] as a function of time [s].

    `text` is a number, or the path of a CSV with the columns time_s, temperature_c; between its
    rows the temperature is interpolated, before and after them it holds.
    """
    try:
        constant = float(text)
    except ValueError:
        return partial(_interpolated, *_read(Path(text)))
    return lambda _: constant


def _read(path: Path) -> tuple[list[float], list[float]]:
    try:
        with path.open(newline='', encoding='utf-8') as file:
            rows = csv.DictReader(line for line in file if not line.startswith('#'))
            missing = [name for name in AMBIENT_COLUMNS if name not in (rows.fieldnames or ())]
            if missing:
                raise AmbientError(
                    f'{path}: no column {missing[0]}; it needs {",".join(AMBIENT_COLUMNS)}'
                )
            points = [(float(row['time_s']), float(row['temperature_c'])) for row in rows]
    except (TypeError, ValueError) as error:
        if isinstance(error, AmbientError):
            raise
        raise AmbientError(f'{path}: {error}') from None
    if not points:
        raise AmbientError(f'{path}: no rows')
    if any(later[0] < earlier[0] for earlier, later in pairwise(points)):
        raise AmbientError(f'{path}: time_s must rise')
    return [time for time, _ in points], [temperature for _, temperature in points]


def _interpolated(times: list[float], temperatures: list[float], time: float) -> float:
    after = bisect_right(times, time)
    if after == 0 or after == len(times):
        return temperatures[min(after, len(times) - 1)]
    share = (time - times[after - 1]) / (times[after] - times[after - 1])
    return temperatures[after - 1] + share * (temperatures[after] - temperatures[after - 1])
