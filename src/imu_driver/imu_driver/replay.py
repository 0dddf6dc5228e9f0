# SPDX-License-Identifier: Apache-2.0
"""A recorded device instead of a connected one: bag://PATH?rate=1&namespace=/dut1.

Samples keep the stamps they were recorded with. `rate` is the pace (2: twice as fast; 0: as fast
as possible).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Final
from urllib.parse import urlsplit

import numpy as np
from imu_recording.recording import SECOND_NS, ImuRecording
from imu_recording.user_error import UserError
from numpy.typing import NDArray

from imu_driver.board.sample import Sample
from imu_driver.board.transport import url_options

TEMPERATURE_INTERVAL_NS: Final = SECOND_NS
"""[ns] between samples of a temperature that stays the same."""


def recorded_samples(recording: ImuRecording) -> Iterator[Sample]:
    """Yield the rows of a recording as samples; a held temperature counts where it is new."""
    has_field = np.isfinite(recording.magnetic_field).all(axis=1)
    stamps = recording.stamp.tolist()
    angular_velocity = recording.angular_velocity.tolist()
    linear_acceleration = recording.linear_acceleration.tolist()
    magnetic_field = recording.magnetic_field.tolist()
    is_new = _new_temperatures(recording)
    for row, (stamp, temperature) in enumerate(
        zip(stamps, recording.temperature.tolist(), strict=True)
    ):
        yield Sample(
            stamp=stamp,
            angular_velocity=tuple(angular_velocity[row]),
            linear_acceleration=tuple(linear_acceleration[row]),
            magnetic_field=tuple(magnetic_field[row]) if has_field[row] else None,
            temperature=temperature if is_new[row] else None,
        )


def _new_temperatures(recording: ImuRecording) -> NDArray[np.bool_]:
    """Return (n,) whether a row holds a new measurement of temperature, or one due again."""
    temperature, measured = recording.temperature, recording.temperature_stamp
    is_new = np.zeros(len(recording), bool)
    if measured is not None:
        is_new[:] = np.diff(measured, prepend=-1) != 0
        return is_new & np.isfinite(temperature)
    held, published_at = float('nan'), 0
    for row in np.flatnonzero(np.isfinite(temperature)).tolist():
        stamp = int(recording.stamp[row])
        if temperature[row] != held or stamp - published_at >= TEMPERATURE_INTERVAL_NS:
            held, published_at = float(temperature[row]), stamp
            is_new[row] = True
    return is_new


class BagReader:
    """Delivers the samples of a bag once, at the pace of their stamps."""

    def __init__(
        self,
        url: str,
        *,
        deliver: Callable[[list[Sample]], None],
        report: Callable[[str], None],
    ) -> None:
        from imu_recording import read_bag  # only now: it brings the bag reader's libraries

        parts = urlsplit(url)
        options = url_options(url, ('rate', 'namespace'))
        try:
            self._pace = float(options.get('rate', '1'))
        except ValueError:
            raise UserError(f'{url}: rate must be a number') from None
        self.recording = read_bag(parts.netloc + parts.path, namespace=options.get('namespace'))
        self._deliver = deliver
        self._report = report
        self.ended = False
        """Whether every sample has been delivered."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='bag_reader', daemon=True)

    def start(self) -> None:
        """Begin to deliver."""
        self._thread.start()

    def stop(self) -> None:
        """Stop delivering."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        for note in self.recording.notes:
            self._report(note)
        first = int(self.recording.stamp[0])
        start = time.monotonic()
        for sample in recorded_samples(self.recording):
            if self._pace > 0:
                due = start + (sample.stamp - first) * 1e-9 / self._pace
                wait = due - time.monotonic()
                if wait > 0 and self._stop.wait(wait):
                    return
            elif self._stop.is_set():
                return
            self._deliver([sample])
        self.ended = True
        self._report(f'the bag has ended after {len(self.recording)} samples')
