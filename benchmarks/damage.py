# SPDX-License-Identifier: Apache-2.0
"""Recordings, tables and model files as they should not be, made from one simulated run."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from imu_recording.bags.messages import BagMessage, bag_topics, read_messages, write_messages
from imu_recording.recording import ImuRecording
from imu_workbench.simulate.campaign import Logging, simulate_run

from imu_recording import write_bag

sys.path.insert(0, str(Path(__file__).parents[1] / 'test' / 'imu_recording'))
from log_writers import dataflash_bytes, ulog_bytes

LOGS: dict[str, Any] = {'ulg': ulog_bytes, 'bin': dataflash_bytes}
"""Logs of autopilots by the suffix of their files."""
LOGGED_ROWS = 200
"""Of the logs that are damaged."""
SECOND = 1_000_000_000
SENSORS = ('angular_velocity', 'linear_acceleration', 'magnetic_field')

Change = Callable[[ImuRecording], ImuRecording]
Make = Callable[['Bench'], list[Path]]


class Bench:
    """A folder with one good run of a simulated device, a model of it, and room for damage."""

    def __init__(self, folder: Path, rate: float = 1.0) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.run = simulate_run(
            'short_20min', 'dut1', Logging(rate, True, 1.0), seed=1, orientation='+z'
        )
        self.model = folder / 'model.yaml'
        self.bag = self.written('good', self.run)
        self.written('good_sqlite', self.run, storage='sqlite3')
        part = self.run.rows(slice(0, LOGGED_ROWS))
        self.logs = {suffix: write([part]) for suffix, write in LOGS.items()}

    def written(self, name: str, *recordings: ImuRecording, storage: str = 'mcap') -> Path:
        """Write recordings as one bag; return it."""
        path = self.folder / name
        shutil.rmtree(path, ignore_errors=True)
        write_bag(recordings, path, storage=storage)
        return path


def changed(name: str, change: Change, bench: Bench) -> list[Path]:
    """Return the bag of the good run after a change."""
    return [bench.written(name, change(bench.run))]


def restamped(name: str, stamps: Callable[[list[int]], list[int]], bench: Bench) -> list[Path]:
    """Return the good bag with other stamps in the headers of its messages, in the same order."""
    topics = bag_topics(bench.bag)
    path = bench.folder / name
    shutil.rmtree(path, ignore_errors=True)
    messages = read_messages(bench.bag, list(topics))
    stamped = [m for m in messages if topics[m.topic].startswith(('sensor_msgs', 'geometry_msgs'))]
    new = dict(zip(map(id, stamped), stamps([m.received for m in stamped]), strict=True))
    written = []
    for message in messages:
        data = message.data
        if id(message) in new:
            seconds, nanoseconds = divmod(new[id(message)], SECOND)
            head = seconds.to_bytes(4, 'little') + nanoseconds.to_bytes(4, 'little')
            data = data[:4] + head + data[12:]
        written.append(BagMessage(message.received, message.topic, data))
    write_messages(written, topics, path)
    return [path]


def part(minutes: float) -> Change:
    """Return what keeps the first minutes."""
    return lambda r: r.rows(r.time < 60.0 * minutes)


def scaled(field: str, factor: float, offset: float = 0.0) -> Change:
    """Return what converts a field into another unit."""
    return lambda r: replace(r, **{field: getattr(r, field) * factor + offset})


def filled(
    value: float, *fields: str, rows: slice = slice(None), axis: Any = slice(None)
) -> Change:
    """Return what writes a value into rows (of one axis) of fields."""

    def change(recording: ImuRecording) -> ImuRecording:
        new = {}
        for field in fields:
            new[field] = np.array(getattr(recording, field))
            new[field][(rows, axis) if new[field].ndim > 1 else rows] = value
        return replace(recording, **new)

    return change


def moving(recording: ImuRecording) -> ImuRecording:
    """Return the device carried about: turned and accelerated all the time."""
    angle = np.sin(2 * np.pi * recording.time / 7.0)
    force = recording.linear_acceleration + 4.0 * angle[:, None]
    rate = recording.angular_velocity + np.cos(2 * np.pi * recording.time / 7.0)[:, None]
    return replace(recording, linear_acceleration=force, angular_velocity=rate)


def bytes_flipped(name: str, share: float, bench: Bench) -> list[Path]:
    """Return the good bag with this share of its bytes replaced."""
    path = bench.folder / name
    shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(bench.bag, path)
    file = next(path.glob('*.mcap'))
    data = np.frombuffer(file.read_bytes(), np.uint8).copy()
    rng = np.random.default_rng(5)
    places = rng.integers(0, len(data), max(int(share * len(data)), 1))
    data[places] = rng.integers(0, 256, len(places))
    file.write_bytes(data.tobytes())
    return [path]


def foreign_topics(bench: Bench) -> list[Path]:
    """Return a bag of the same messages under a robot's own names."""
    types = bag_topics(bench.bag)
    path = bench.folder / 'foreign_topics'
    shutil.rmtree(path, ignore_errors=True)
    messages = [
        replace(m, topic=f'/robot{m.topic}_x') for m in read_messages(bench.bag, list(types))
    ]
    write_messages(messages, {f'/robot{t}_x': kind for t, kind in types.items()}, path)
    return [path]


def file_with(name: str, content: bytes, bench: Bench) -> list[Path]:
    """Return a file that is no bag."""
    path = bench.folder / name
    path.write_bytes(content)
    return [path]


def empty_folder(bench: Bench) -> list[Path]:
    """Return a folder without files."""
    path = bench.folder / 'empty_folder'
    path.mkdir(exist_ok=True)
    return [path]


def two_devices(bench: Bench) -> list[Path]:
    """Return one bag that holds two devices."""
    pair = [replace(bench.run, device=d, namespace=f'/{d}') for d in ('dut1', 'dut2')]
    return [bench.written('two_devices', *pair)]


def two_bags(bench: Bench) -> list[Path]:
    """Return the bags of two devices."""
    other = scaled('temperature', 1.0, 1e-3)(replace(bench.run, device='dut2'))
    return [bench.bag, bench.written('other_device', other)]


def _named(label: str) -> str:
    return label.replace(' ', '_').replace('°', '')


CHANGES: dict[str, Change] = {
    '1 sample': lambda r: r.rows(slice(0, 1)),
    '3 samples': lambda r: r.rows(slice(0, 3)),
    '2 min': part(2.0),
    '8 min': part(8.0),
    '20 min': part(20.0),
    'constant temperature': filled(21.5, 'temperature'),
    'one axis dead': filled(0.0, 'angular_velocity', axis=1),
    'vertical axis dead': filled(0.0, 'linear_acceleration', axis=2),
    'NaN': filled(np.nan, *SENSORS),
    'NaN for a while': filled(np.nan, *SENSORS, rows=slice(100, 400)),
    'NaN temperature': filled(np.nan, 'temperature'),
    'Inf': filled(np.inf, *SENSORS, rows=slice(0, None, 3)),
    'huge values': filled(3.4e127, *SENSORS, rows=slice(50, 60)),
    'no magnetometer': filled(np.nan, 'magnetic_field'),
    'in g': scaled('linear_acceleration', 1 / 9.80665),
    'in °/s': scaled('angular_velocity', 180 / np.pi),
    'in gauss': scaled('magnetic_field', 1e4),
    'in °F': scaled('temperature', 1.8, 32.0),
    'in kelvin': scaled('temperature', 1.0, 273.15),
    'moving': moving,
    'no names': lambda r: replace(r, device='', run='', up_axis='', profile=''),
}
STAMPS: dict[str, Callable[[list[int]], list[int]]] = {
    'zero stamps': lambda s: [0] * len(s),
    'some zero stamps': lambda s: [0 if k % 5 else t for k, t in enumerate(s)],
    'first stamp near zero': lambda s: [5] + s[1:],
    'before time synchronisation': lambda s: [
        t - s[0] if t < s[0] + 10 * SECOND else t for t in s
    ],
    'a jump of a day': lambda s: [t + (t > s[len(s) // 2]) * 86400 * SECOND for t in s],
    'a clock set back': lambda s: [t - (t > s[len(s) // 3]) * 200 * SECOND for t in s],
    'disorder': lambda s: np.random.default_rng(3).permutation(s).tolist(),
    'duplicated stamps': lambda s: [s[k - k % 4] for k in range(len(s))],
    'wild stamps': lambda s: np.random.default_rng(4).integers(0, 2**60, len(s)).tolist(),
}
INPUTS: dict[str, Make] = {
    'good': lambda bench: [bench.bag],
    **{name: partial(changed, _named(name), change) for name, change in CHANGES.items()},
    **{name: partial(restamped, _named(name), stamps) for name, stamps in STAMPS.items()},
    'two devices in a bag': two_devices,
    'bags of two devices': two_bags,
    'the same bag twice': lambda bench: [bench.bag, bench.bag],
    'one byte flipped': partial(bytes_flipped, 'flipped_one', 0.0),
    'bytes flipped': partial(bytes_flipped, 'flipped_some', 1e-4),
    'many bytes flipped': partial(bytes_flipped, 'flipped_many', 0.01),
    'foreign topics': foreign_topics,
    'an empty file': partial(file_with, 'empty.mcap', b''),
    'an empty folder': empty_folder,
    'no such file': lambda bench: [bench.folder / 'nowhere'],
    'a text': partial(file_with, 'notes.txt', b'thesis, chapter 3'),
    'a head only': partial(file_with, 'head.mcap', b'\x89MCAP0\r\n'),
}
"""Bags as they come, by what is wrong with them."""


def document(bench: Bench) -> Any:
    """Return the content of the good model."""
    return yaml.safe_load(bench.model.read_text('utf-8'))


def model_with(place: tuple[str | int, ...], value: Any, bench: Bench) -> str:
    """Return the good model's text with one value replaced."""
    content = document(bench)
    entry = content
    for key in place[:-1]:
        entry = entry[key]
    entry[place[-1]] = value
    return yaml.safe_dump(content, allow_unicode=True)


COEFFICIENTS = ('sensors', 'accelerometer', 'effects', 0, 'coefficients')
MODELS: dict[str, Callable[[Bench], str]] = {
    'coefficients of 1e300': partial(model_with, COEFFICIENTS, [[1e300, 0.0, 0.0]]),
    'an error of 12 910 m/s²': partial(model_with, COEFFICIENTS, [[0.0, 430.0, 0.0]]),
    'NaN coefficients': partial(model_with, COEFFICIENTS, [[float('nan'), 0.0, 0.0]]),
    'reference of 1e6 °C': partial(model_with, ('reference_temperature', 'value'), 1e6),
    'another device': partial(model_with, ('device',), 'dut9'),
    'another unit': partial(model_with, ('sensors', 'gyroscope', 'unit'), '°/s'),
    'an effect nobody knows': partial(
        model_with, ('sensors', 'gyroscope', 'effects', 0, 'name'), 'gremlins'
    ),
    'half a file': lambda bench: bench.model.read_text('utf-8')[:700],
    'no YAML': lambda _: 'device: [dut1\n',
    'an empty model': lambda _: '',
}
"""Model files as they come, by what is wrong with them."""


def fuzzed(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes damaged in one of the ways storage and transport damage them."""
    if not data:
        return data
    at = int(rng.integers(0, len(data)))
    length = int(min(rng.integers(1, 64), len(data) - at))
    kind = int(rng.integers(0, 8))
    if kind == 0:  # one bit
        return data[:at] + bytes([data[at] ^ 1 << int(rng.integers(0, 8))]) + data[at + 1 :]
    if kind == 1:  # cut
        return data[:at]
    if kind == 2:  # a part lost
        return data[:at] + data[at + length :]
    if kind == 3:  # a part twice
        return data[: at + length] + data[at:]
    if kind == 4:  # an unwritten sector
        return data[:at] + bytes(length) + data[at + length :]
    if kind == 5:  # an erased sector
        return data[:at] + b'\xff' * length + data[at + length :]
    if kind == 6:  # noise
        return data[:at] + rng.bytes(length) + data[at + length :]
    count = int(rng.integers(2, 30))  # single bytes all over
    damaged = bytearray(data)
    for place in rng.integers(0, len(data), count).tolist():
        damaged[place] = int(rng.integers(0, 256))
    return bytes(damaged)
