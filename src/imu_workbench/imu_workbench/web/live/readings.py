# SPDX-License-Identifier: Apache-2.0
"""Readings of a running device for the page: numbers and lines from a LiveState."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import SECOND_NS, FloatArray
from orientation_filters.rotation.arrays import conjugate, euler_zyx, multiply, rotation_angle

from imu_workbench.web.live.state import FILTERS, LiveState, NodeStatus

ZERO_SECONDS = 10
"""The static residual counts from the mean of this many seconds."""
MAX_TILT_DEG = 3.0
"""From this tilt on, the device was turned since the zero: the change is no error."""
FULL_RATE_S = 30.0
"""Up to this window every sample is drawn, beyond it means of seconds."""
MAX_LAG_NS = 5 * SECOND_NS
"""Raw and compensated samples further apart are not shown for the same second [ns]."""
MAX_EULER_ROWS = 1000
"""Attitudes of a window converted to angles at most."""
VERDICT_S = 600
"""Length of the newest part that the verdict is on [s]."""
LEAST_VERDICT_S = 60
"""Least length for a verdict [s]."""
TEMPERATURE_TRACKS = ('temperature', 'device', 'air', 'setpoint')


@dataclass(frozen=True)
class SensorTracks:
    """Tracks and columns that hold the samples of a sensor."""

    raw: str
    compensated: str
    difference: str
    columns: slice


SENSOR_TRACKS = {
    'gyroscope': SensorTracks('raw', 'compensated', 'difference', slice(0, 3)),
    'accelerometer': SensorTracks('raw', 'compensated', 'difference', slice(3, 6)),
    'magnetometer': SensorTracks(
        'raw_field', 'compensated_field', 'difference_field', slice(0, 3)
    ),
}


@dataclass(frozen=True, eq=False)
class LiveLine:
    """Values over time."""

    time: FloatArray
    """(n,) [s] before the newest sample: ≤ 0."""
    values: FloatArray
    """(n, k) SI."""


@dataclass(frozen=True, eq=False)
class Reading:
    """A sensor now: means over the last second, (3,) each, NaN where nothing is heard."""

    raw: FloatArray
    compensated: FloatArray
    difference: FloatArray
    """Raw − compensated: what the model says the error is."""
    static: FloatArray
    """Compensated (raw, where nothing compensates) − its mean at the zero."""
    noise: FloatArray
    """Standard deviation within the second."""


@dataclass(frozen=True, eq=False)
class LiveAttitude:
    """Newest orientation of a filter."""

    orientation: FloatArray
    """(4,) xyzw, sensor → world."""
    euler: FloatArray
    """(3,) roll, pitch, yaw [rad]."""


def newest(state: LiveState) -> int:
    """Return the newest stamp of the device [ns], of anything where the IMU is silent."""
    imu = max(state.tracks['raw'].newest, state.tracks['compensated'].newest)
    return imu if imu >= 0 else max(track.newest for track in state.tracks.values())


def line(state: LiveState, name: str, window_s: float, columns: slice = slice(None)) -> LiveLine:
    """Return the last `window_s` seconds of a track."""
    track, end = state.tracks[name], newest(state)
    begin = end - int(window_s * SECOND_NS)
    if window_s <= FULL_RATE_S:
        rows = track.recent.since(begin)
        return LiveLine((rows.stamp - end) / SECOND_NS, rows.values[:, columns])
    second, means = track.history.means(-(-begin // SECOND_NS), end // SECOND_NS)
    middle = second * SECOND_NS + SECOND_NS // 2 - end
    return LiveLine(middle / SECOND_NS, means[:, columns])


def zero_second(state: LiveState) -> int:
    """Return the newest second: give it to `reading` later to count from now [s of the stamp]."""
    return newest(state) // SECOND_NS


def static_line(state: LiveState, sensor: str, window_s: float, zero: int) -> LiveLine:
    """Return what compensation leaves, counted from the zero."""
    tracks = SENSOR_TRACKS[sensor]
    name = _static_track(state, sensor)
    lines = line(state, name, window_s, tracks.columns)
    return LiveLine(lines.time, lines.values - _zero_of(state, name, zero)[tracks.columns])


def reading(state: LiveState, sensor: str, zero: int) -> Reading:
    """Return the sensor's last second; `zero` [s of the stamp], 0: the first seconds heard."""
    tracks = SENSOR_TRACKS[sensor]
    names = (tracks.raw, tracks.compensated, tracks.difference)
    end = state.tracks[tracks.difference].newest  # both are heard up to here
    raw, compensated, difference = (
        _last_second(state, name, end)[:, tracks.columns] for name in names
    )
    name = _static_track(state, sensor)
    left = raw if name == tracks.raw else compensated
    reference = _zero_of(state, name, zero)[tracks.columns]
    return Reading(
        raw=raw[0],
        compensated=compensated[0],
        difference=difference[0],
        static=left[0] - reference,
        noise=left[1],
    )


def over_noise(state: LiveState, sensor: str, zero: int) -> FloatArray:
    """Return rms of the static residual in means of a second, in units of their noise (3,).

    The noise is told by neighbouring seconds, σ² = ⟨(x₊₁ − x)²⟩ / 2 (von Neumann 1941), which no
    slow error disturbs: 1 is noise alone. NaN before LEAST_VERDICT_S have been heard.
    """
    name = _static_track(state, sensor)
    history, end = state.tracks[name].history, newest(state) // SECOND_NS
    second, means = history.means(max(end - VERDICT_S, zero, 0), end)
    left = (means - _zero_of(state, name, zero))[:, SENSOR_TRACKS[sensor].columns]
    steps = np.diff(left, axis=0)[np.diff(second) == 1]
    steps = steps[np.isfinite(steps).all(axis=1)]
    if len(steps) < LEAST_VERDICT_S:
        return np.full(3, np.nan)
    noise = np.sqrt(0.5 * (steps**2).mean(axis=0))
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.asarray(np.sqrt(np.nanmean(left**2, axis=0)) / noise)


def tilt_since_zero_deg(state: LiveState, zero: int) -> float:
    """Return by how much the device tilts against the zero [°]; NaN where unknown."""
    name = _static_track(state, 'accelerometer')
    here, there = _last_second(state, name)[0, 3:], _zero_of(state, name, zero)[3:]
    size = float(np.linalg.norm(here) * np.linalg.norm(there))
    if not size > 0.0:
        return math.nan
    return math.degrees(math.acos(max(-1.0, min(1.0, float(here @ there) / size))))


def attitude(state: LiveState, name: str) -> LiveAttitude | None:
    """Return the newest orientation of a filter; None where it publishes none."""
    values = state.tracks[name].recent.since(state.tracks[name].newest - SECOND_NS).values
    known = values[np.isfinite(values).all(1)]
    if not len(known) or not np.linalg.norm(known[-1]) > 0.0:
        return None
    orientation = known[-1] / np.linalg.norm(known[-1])
    return LiveAttitude(orientation, euler_zyx(orientation))


def angle_between_deg(first: LiveAttitude, second: LiveAttitude) -> float:
    """Return the angle of the rotation between two attitudes [°]."""
    between = multiply(conjugate(first.orientation), second.orientation)
    return math.degrees(float(rotation_angle(between)))


def euler_line(state: LiveState, name: str, window_s: float) -> LiveLine:
    """Return roll, pitch, yaw of a filter over time [rad]."""
    lines = line(state, name, window_s)
    every = max(1, len(lines.time) // MAX_EULER_ROWS)  # an attitude is smooth: no extreme is lost
    lines = LiveLine(lines.time[::every], lines.values[::every])
    norm = np.linalg.norm(lines.values, axis=1, keepdims=True)
    with np.errstate(invalid='ignore', divide='ignore'):
        return LiveLine(lines.time, euler_zyx(lines.values / norm))


def value_of(state: LiveState, name: str) -> float:
    """Return the newest value of a temperature [°C]; NaN where nothing is heard."""
    rows = state.tracks[name].recent.since(state.tracks[name].newest)
    return float(rows.values[-1, 0]) if len(rows.values) else math.nan


def warming_c_per_min(state: LiveState, name: str = 'temperature') -> float:
    """Return the slope of the last minute's temperature [°C/min]; NaN before ten seconds."""
    lines = line(state, name, 60.0)
    known = np.isfinite(lines.values).all(1) if len(lines.values) else np.zeros(0, bool)
    time, values = lines.time[known], lines.values[known]
    if len(time) < 10:
        return math.nan
    return float(np.polyfit(time, values[:, 0], 1)[0]) * 60.0


def rate_hz(state: LiveState, name: str) -> float:
    """Return the rate of a topic over its last two seconds of stamps [Hz]."""
    track = state.tracks[name]
    stamp = track.recent.since(track.newest - 2 * SECOND_NS).stamp
    span = int(stamp.max() - stamp.min()) if len(stamp) > 1 else 0
    return (len(stamp) - 1) * SECOND_NS / span if span else 0.0


def silence_s(state: LiveState, name: str) -> float:
    """Return for how long nothing was heard [s]; infinite where nothing ever was."""
    return state.now() - state.tracks[name].received


def chamber_times(statuses: dict[str, NodeStatus]) -> tuple[float, float]:
    """Return the time left of the phase and of the run [s]; NaN where no chamber node runs."""
    for status in statuses.values():
        if 'run_left [s]' in status.values and status.values.get('mode') not in ('', 'IDLE'):
            return float(status.values['phase_left [s]']), float(status.values['run_left [s]'])
    return math.nan, math.nan


def orientation_names(state: LiveState) -> list[str]:
    """Return the filters that publish."""
    return [name for name in FILTERS if state.tracks[name].newest >= 0]


def _static_track(state: LiveState, sensor: str) -> str:
    tracks = SENSOR_TRACKS[sensor]
    return tracks.compensated if state.tracks[tracks.compensated].newest >= 0 else tracks.raw


def _last_second(state: LiveState, name: str, end: int = -1) -> FloatArray:
    """Return mean and standard deviation of the second up to `end` [ns] (2, k).

    −1, or an end that is no longer within the newest samples: the newest second.
    """
    track = state.tracks[name]
    end = end if track.newest - MAX_LAG_NS < end <= track.newest else track.newest
    rows = track.recent.since(end - SECOND_NS + 1)
    values = rows.values[rows.stamp <= end]
    columns = [column[np.isfinite(column)] for column in values.T]
    return np.array([[f(c) if len(c) else np.nan for c in columns] for f in (np.mean, np.std)])


def _zero_of(state: LiveState, name: str, zero: int) -> FloatArray:
    """Return the mean of the zero's seconds (k,)."""
    history = state.tracks[name].history
    begin = max(zero, history.oldest)
    _, means = history.means(begin, begin + ZERO_SECONDS)
    return np.asarray(means.mean(0)) if len(means) else np.full(means.shape[1], np.nan)
