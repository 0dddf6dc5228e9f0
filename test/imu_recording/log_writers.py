# SPDX-License-Identifier: Apache-2.0
"""Write recordings as the logs an autopilot would have kept of them, for tests and trials.

usage: python test/imu_recording/log_writers.py BAG… -o LOG.ulg|LOG.bin      (one bag per IMU)
       … --bytes 4e9              the recording again and again, until the log is that long

The formats are those of the PX4 documentation (ULog file format) and of ArduPilot's AP_Logger.
Axes are written as they are; values in single precision, times in whole microseconds.
"""

from __future__ import annotations

import argparse
import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from imu_recording import ImuRecording, read_bag

SERIAL_NUMBER = '000100000000303132333435363738390a0b'
BOARD = 'SimBoard 00280030 3133510D 38363035'
GAUSS_PER_TESLA = 1e4


def microseconds(recording: ImuRecording, start: int) -> list[int]:
    """Times since power-on, which is `start` µs before the first sample."""
    return ((recording.stamp - recording.stamp[0]) // 1000 + start).tolist()


def gps_times(
    recording: ImuRecording, start: int, power_on: float
) -> Iterable[tuple[int, int, float]]:
    """Each second: time since power-on [µs], status of the fix, Unix time [s]; 0 without a fix."""
    last = microseconds(recording, start)[-1]
    for number, t in enumerate(range(start, last, 1_000_000)):
        yield (t, 3, power_on + 1e-6 * t) if number > 1 else (t, 1, 0.0)


# PX4 ---------------------------------------------------------------------------------------------

ULOG_FORMATS = {
    'sensor_accel': 'uint32_t device_id;float x;float y;float z;float temperature;',
    'sensor_gyro': 'uint32_t device_id;float x;float y;float z;float temperature;',
    'sensor_mag': 'uint32_t device_id;float x;float y;float z;',
    'sensor_baro': 'uint32_t device_id;float pressure;float temperature;',
    'sensor_gps': 'uint64_t time_utc_usec;uint8_t fix_type;',
}


def ulog_bytes(
    recordings: Sequence[ImuRecording],
    *,
    parameters: Mapping[str, float] | None = None,
    start: int = 5_000_000,
    accelerometer_delay: int = 0,
    data_alone: bool = False,
    power_on: float | None = None,
) -> bytes:
    """A ULog with one accelerometer, gyroscope and magnetometer a recording, and one barometer.

    `data_alone` leaves out what stands before the data: to append to another log. `power_on`:
    Unix time of the clock's zero [s], which a GPS receiver tells.
    """
    parts = [b'ULog\x01\x12\x35\x01' + struct.pack('<Q', start)]
    parts.append(_ulog('B', bytes(40)))
    for name, fields in ULOG_FORMATS.items():
        text = f'{name}:uint64_t timestamp;uint64_t timestamp_sample;{fields}'
        parts.append(_ulog('F', text.encode()))
    info = {'sys_name': 'PX4', 'ver_hw': 'SIMULATED', 'sys_uuid': SERIAL_NUMBER}
    for key, value in info.items():
        parts.append(_ulog('I', _key(f'char[{len(value)}] {key}') + value.encode()))
    for key, number in (parameters or {}).items():
        parts.append(_ulog('P', _key(f'float {key}') + struct.pack('<f', number)))
    topics = [(name, k) for name in list(ULOG_FORMATS)[:3] for k in range(len(recordings))]
    topics.append(('sensor_baro', 0))
    topics += [] if power_on is None else [('sensor_gps', 0)]
    for number, (name, instance) in enumerate(topics):
        parts.append(_ulog('A', struct.pack('<BH', instance, number) + name.encode()))
    messages = []
    parts = [] if data_alone else parts
    for number, (name, instance) in enumerate(topics):
        recording = recordings[instance]
        if name == 'sensor_gps':
            for t, fix, utc in gps_times(recording, start, power_on or 0.0):
                data = struct.pack('<HQQQB', number, t, t, round(1e6 * utc), fix)
                messages.append((t, number, _ulog('D', data)))
            continue
        delay = accelerometer_delay if name == 'sensor_accel' else 0
        for t, device, values in _ulog_samples(name, instance, recording, start):
            when = t + delay
            data = struct.pack(f'<HQQI{len(values)}f', number, when + 40, when, device, *values)
            messages.append((when, number, _ulog('D', data)))
    parts += [message for _, _, message in sorted(messages)]
    return b''.join(parts)


def _ulog_samples(
    name: str, instance: int, recording: ImuRecording, start: int
) -> Iterable[tuple[int, int, list[float]]]:
    times = microseconds(recording, start)
    warmth = recording.temperature.tolist()
    device = 1000 + 10 * instance
    if name == 'sensor_baro':
        board = recording.device_temperature
        other = warmth if board is None else board.tolist()
        return ((t, 77, [1013.25, b]) for t, b in zip(times, other, strict=True))
    if name == 'sensor_mag':
        rows = (GAUSS_PER_TESLA * recording.magnetic_field).tolist()
        return (
            (t, device + 5, v) for t, v in zip(times, rows, strict=True) if np.isfinite(v).all()
        )
    accelerometer = name == 'sensor_accel'
    measured = recording.linear_acceleration if accelerometer else recording.angular_velocity
    rows = zip(times, measured.tolist(), warmth, strict=True)
    return ((t, device, [*v, warm]) for t, v, warm in rows)


def _ulog(kind: str, payload: bytes) -> bytes:
    return struct.pack('<HB', len(payload), ord(kind)) + payload


def _key(text: str) -> bytes:
    return struct.pack('<B', len(text)) + text.encode()


# ArduPilot ---------------------------------------------------------------------------------------

DATAFLASH_FORMATS = {
    'FMT': (128, 'BBnNZ', 'Type,Length,Name,Format,Columns'),
    'PARM': (129, 'QNf', 'TimeUS,Name,Value'),
    'MSG': (130, 'QZ', 'TimeUS,Message'),
    'IMU': (
        131,
        'QBffffffIIfBBHH',
        'TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz',
    ),
    'MAG': (
        132,
        'QBhhhhhhhhhBI',
        'TimeUS,I,MagX,MagY,MagZ,OfsX,OfsY,OfsZ,MOX,MOY,MOZ,Health,S',
    ),
    'BARO': (133, 'QBffc', 'TimeUS,I,Alt,Press,Temp'),
    'GPS': (134, 'QBBIH', 'TimeUS,I,Status,GMS,GWk'),
}
ITEMS = {'n': '4s', 'N': '16s', 'Z': '64s', 'c': 'h'}


def dataflash_bytes(
    recordings: Sequence[ImuRecording],
    *,
    parameters: Mapping[str, float] | None = None,
    start: int = 5_000_000,
    without_temperature: bool = False,
    power_on: float | None = None,
) -> bytes:
    """A DataFlash log with one IMU a recording, their magnetometers, and one barometer.

    `power_on`: Unix time of the clock's zero [s], which a GPS receiver tells.
    """
    formats = dict(DATAFLASH_FORMATS)
    if without_temperature:
        number, _, columns = formats['IMU']
        formats['IMU'] = (number, 'QBffffffIIBBHH', columns.replace(',T,', ','))
    parts = [_dataflash_format(formats, name) for name in formats]
    for key, value in (parameters or {}).items():
        parts.append(_dataflash(formats, 'PARM', start, key.encode(), value))
    said = ('ArduCopter V4.5.7 (simulated)', BOARD)
    parts += [_dataflash(formats, 'MSG', start, text.encode()) for text in said]
    messages = []
    for t, fix, utc in gps_times(recordings[0], start, power_on) if power_on else ():
        week, second = divmod(utc - 315_964_800 + 18, 604_800) if utc else (0, 0.0)
        data = _dataflash(formats, 'GPS', t, 0, fix, round(1e3 * second), int(week))
        messages.append((t, 0, data))
    for k, recording in enumerate(recordings):
        for t, row in zip(microseconds(recording, start), _rows(recording), strict=True):
            rate, force, field, warm, board = row
            health = (1, 1, 1000, 1000)
            temperature = () if without_temperature else (warm,)
            values = (t, k, *rate, *force, 0, 0, *temperature, *health)
            messages.append((t, k, _dataflash(formats, 'IMU', *values)))
            if np.isfinite(field).all():
                milligauss = np.rint(1e3 * GAUSS_PER_TESLA * np.array(field)).astype(int).tolist()
                data = _dataflash(formats, 'MAG', t, k, *milligauss, *(0,) * 6, 1, 0)
                messages.append((t, k, data))
            if k == 0:
                centidegrees = round(100.0 * board)
                messages.append((t, k, _dataflash(formats, 'BARO', t, 0, 0.0, 1e5, centidegrees)))
    return b''.join(
        [*parts, *(message for _, _, message in sorted(messages, key=lambda m: m[:2]))]
    )


def _rows(
    recording: ImuRecording,
) -> Iterable[tuple[list[float], list[float], list[float], float, float]]:
    board = recording.device_temperature
    return zip(
        recording.angular_velocity.tolist(),
        recording.linear_acceleration.tolist(),
        recording.magnetic_field.tolist(),
        recording.temperature.tolist(),
        (recording.temperature if board is None else board).tolist(),
        strict=True,
    )


def _layout(form: str) -> str:
    return '<' + ''.join(ITEMS.get(item, item) for item in form)


def _dataflash_format(formats: Mapping[str, tuple[int, str, str]], name: str) -> bytes:
    number, form, columns = formats[name]
    length = 3 + struct.calcsize(_layout(form))
    head = (number, length, name.encode(), form.encode(), columns.encode())
    return _dataflash(formats, 'FMT', *head)


def _dataflash(formats: Mapping[str, tuple[int, str, str]], name: str, *values: object) -> bytes:
    number, form, _ = formats[name]
    return b'\xa3\x95' + bytes([number]) + struct.pack(_layout(form), *values)


# Both --------------------------------------------------------------------------------------------


def times_in(log: bytes) -> tuple[int, list[int], list[int]]:
    """Where the data of a log begin, and the places of their times [µs]: of each, and all."""
    ulog = log.startswith(b'ULog')
    lengths = {n: 3 + struct.calcsize(_layout(form)) for n, form, _ in DATAFLASH_FORMATS.values()}
    at = 16 if ulog else 0
    begin, first, every = 0, [], []
    while at < len(log):
        if ulog:
            size, kind = struct.unpack_from('<HB', log, at)
            length, samples, place = 3 + size, kind == ord('D'), at + 5
        else:
            length, samples, place = lengths[log[at + 2]], log[at + 2] > 130, at + 3
        if samples:
            begin = begin or at
            first.append(place)
            every += [place, place + 8] if ulog else [place]
        at += length
    return begin, first, every


def write_repeated(log: bytes, path: Path, size: float) -> None:
    """Write a log whose samples follow again and again, each time later, until it has `size`."""
    begin, first, every = times_in(log)
    samples = np.frombuffer(log[begin:], np.uint8).copy()
    time = [struct.unpack_from('<Q', log, place)[0] for place in (first[0], first[-1])]
    period = time[1] - time[0] + 1000
    places = np.array(every)[:, None] - begin + np.arange(8)
    with path.open('wb') as stream:
        stream.write(log)
        while stream.tell() < size:
            later = samples[places].view('<u8') + np.uint64(period)
            samples[places] = later.view(np.uint8)
            stream.write(samples.data)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('bags', nargs='+', type=Path)
    parser.add_argument('-o', '--output', required=True, type=Path)
    parser.add_argument('--bytes', type=float, default=0.0, help='length of the log, at least')
    options = parser.parse_args()
    recordings = [read_bag(bag) for bag in options.bags]
    write = dataflash_bytes if options.output.suffix == '.bin' else ulog_bytes
    write_repeated(write(recordings), options.output, options.bytes)


if __name__ == '__main__':
    main()
