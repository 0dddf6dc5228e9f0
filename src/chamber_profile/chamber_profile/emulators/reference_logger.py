# SPDX-License-Identifier: Apache-2.0
"""An emulated data logger: two PT100 and a thermocouple per device, one line a second."""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError

from chamber_profile.emulators.endpoint import (
    add_endpoint_arguments,
    caught_signals,
    open_endpoint,
)

LINE_PERIOD_S = 1.0
"""Time between two lines [s]."""
DEVICE_TIME_CONSTANT_S = 180.0
"""Time constant of a device behind the air [s]."""
SELF_HEATING_K = 1.2
"""Temperature of a device above the air [K]."""


class Listener:
    """Ignores what clients send: a data logger takes no requests."""

    def feed(self, _: bytes) -> list[bytes]:
        """Return nothing."""
        return []


class LoggerSensors:
    """PT100 and thermocouples in air that follows a table (time [s], temperature [°C])."""

    def __init__(self, time_s: FloatArray, air_c: FloatArray, devices: int, seed: int) -> None:
        self._time, self._air = time_s, air_c
        self._rng = np.random.default_rng(seed)
        self._offsets = self._rng.normal(0.0, 0.05, 2)
        self._couple_offsets = self._rng.normal(0.0, 0.3, devices)
        self._devices = np.full(devices, air_c[0] + SELF_HEATING_K)
        self._at = float(time_s[0])

    def line(self, time_s: float) -> str:
        """Return the logger's line at a time [s]: time, PT100, PT100, thermocouples."""
        air = float(np.interp(time_s, self._time, self._air))
        share = 1.0 - np.exp(-max(time_s - self._at, 0.0) / DEVICE_TIME_CONSTANT_S)
        self._at = max(time_s, self._at)
        self._devices += share * (air + SELF_HEATING_K - self._devices)
        probes = air + self._offsets + self._rng.normal(0.0, 0.01, 2)
        noise = self._rng.normal(0.0, 0.05, len(self._devices))
        couples = self._devices + self._couple_offsets + noise
        fields = [f'{value:.2f}' for value in probes] + [f'{value:.1f}' for value in couples]
        return ','.join([f'{time_s:.1f}', *fields])


def read_table(path: Path | None) -> tuple[FloatArray, FloatArray]:
    """Return time and temperature of a CSV `time_s,temperature_c`; None: a room at 23 °C."""
    if path is None:
        return np.array([0.0]), np.array([23.0])
    with path.open(encoding='utf-8', newline='') as stream:
        try:
            rows = [
                (float(row['time_s']), float(row['temperature_c']))
                for row in csv.DictReader(stream)
            ]
        except (KeyError, TypeError, ValueError) as error:
            raise UserError(f'{path}: expected columns time_s,temperature_c: {error}') from error
    if not rows:
        raise UserError(f'{path}: no row')
    table = np.array(rows).T
    return table[0], table[1]


def build_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog='emulated_reference_logger',
        description='Emulate a data logger: a line a second with time, two PT100, thermocouples.',
    )
    add_endpoint_arguments(parser)
    parser.add_argument('--temperature', metavar='CSV', type=Path, help='as plan --csv writes')
    parser.add_argument('--devices', type=int, default=3, help='number of thermocouples')
    parser.add_argument(
        '--time-scale', metavar='X', type=float, default=1.0, help='table seconds per second'
    )
    parser.add_argument('--seed', type=int, default=0)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Write lines until interrupted; return the process's exit code."""
    options = build_parser().parse_args(argv)
    interrupted = caught_signals()
    try:
        sensors = LoggerSensors(*read_table(options.temperature), options.devices, options.seed)
        endpoint = open_endpoint(options, Listener)
    except (ValueError, OSError) as error:
        sys.stderr.write(f'emulated_reference_logger: {error}\n')
        return 2
    sys.stdout.write(f'reference logger at {endpoint.name}\n')
    sys.stdout.flush()
    began = due = time.monotonic()
    try:
        while not interrupted:
            endpoint.serve(0.05, set)
            if time.monotonic() >= due:
                due += LINE_PERIOD_S
                now = (time.monotonic() - began) * options.time_scale
                endpoint.send(sensors.line(now).encode('ascii') + b'\r\n')
    finally:
        endpoint.close()
    return 0
