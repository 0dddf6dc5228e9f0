# SPDX-License-Identifier: Apache-2.0
"""Device ticks to ROS time by alternating lower convex hulls.

A sample arrives late by a delay that is never negative, so the points (tick, arrival) lie above
the line that maps ticks to true time; the lower convex hull of the points touches it wherever the
delay was smallest. L. Zhang, Z. Liu, C. H. Xia, "Clock synchronization algorithms for network
measurements", INFOCOM 2002; two hulls that take turns follow a wandering crystal.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from imu_recording.recording import SECOND_NS

TICK_RANGE: Final = 1 << 32
"""[ticks] Range of the device's counter."""
HALF_RANGE: Final = 1 << 31

LARGEST_SKEW: Final = 1e-2
"""Relative; more than a ceramic resonator is off, let alone a crystal."""
SKEW_BASELINE_S: Final = 5.0
"""[s] Shortest span of data that determines the skew under delays of milliseconds."""
STEP_S: Final = 0.5
"""[s] Change of the delay above which the host's clock has stepped."""
STEP_DURATION_S: Final = 3.0
"""[s] Time that such a change lasts; a stall of the host ends sooner."""
RESIDUAL_WEIGHT: Final = 1e-3
"""Of one sample in the running mean and variance of the delay."""


@dataclass
class ConvexHull:
    """Lower convex hull of points that come with rising abscissa."""

    points: list[tuple[float, float]] = field(default_factory=list)
    """(device time, arrival minus device time), both [s] since the clock's start."""
    slope: float = 0.0
    """Slope of the last good line."""

    def add(self, x: float, y: float) -> None:
        """Add a point to the right of all others."""
        points = self.points
        while len(points) > 1:
            (x1, y1), (x2, y2) = points[-2], points[-1]
            if (y2 - y1) * (x - x2) < (y - y2) * (x2 - x1):
                break
            points.pop()
        points.append((x, y))

    def line(self) -> tuple[float, float, float]:
        """Return the line that supports the points from below: abscissa, ordinate, slope.

        It is the hull's edge over the middle of its span. Where that edge ends in the newest
        point, every sample of the later half was delayed: then the slope found last holds.
        """
        points = self.points
        if points[-1][0] - points[0][0] >= SKEW_BASELINE_S:
            middle = 0.5 * (points[0][0] + points[-1][0])
            index = bisect_left(points, (middle,))
            if index < len(points) - 1:
                (x1, y1), (x2, y2) = points[index - 1], points[index]
                slope = (y2 - y1) / (x2 - x1)
                if abs(slope) <= LARGEST_SKEW:
                    self.slope = slope
                    return x2, y2, slope
        x, y = min(points, key=lambda point: point[1] - self.slope * point[0])
        return x, y, self.slope


class Observation(NamedTuple):
    """A sample the clock has taken in and not yet stamped."""

    tick: int
    arrival: int
    origin: int
    """Arrival of the first sample since the device's start [ns]."""
    elapsed: int
    """Ticks since that sample."""
    time: float
    """The same [s]."""
    offset: float
    """Arrival after `origin` minus `time` [s]."""


class DeviceClock:
    """Stamps the samples of one device: feed (tick, arrival) in order, get ROS time [ns].

    Stamps never go backwards and never lie after the arrival. A tick that jumps backwards means
    that the device restarted: the estimate starts anew. So it does where the host's clock was
    set; only where it was set back do stamps follow it backwards.
    `wraps`, `resets` and `steps` count.
    """

    def __init__(
        self, *, tick_rate: float = 1e6, latency: float = 0.0, window: float = 60.0
    ) -> None:
        self.tick_rate = tick_rate
        self.latency = latency
        """[s] from sample to arrival at the least; subtracted."""
        self.window = window
        """[s] after which the two hulls change places."""
        self.wraps = 0
        self.resets = 0
        self.steps = 0
        self.residual = 0.0
        """[s] RMS of arrival minus stamp about its mean, over about the last 1000 samples."""
        self._last_stamp = 0
        self._residual_mean = 0.0
        self._residual_variance = 0.0
        self._start()

    def _start(self) -> None:
        self._active = ConvexHull()
        self._pending = ConvexHull()
        self._switch_at = self.window
        self._origin: int | None = None
        self._tick = 0
        self._elapsed = 0
        self._arrival = 0
        self._jumped_at = math.inf
        self._last_offset = 0.0

    def restart(self) -> None:
        """Forget the device's time: the device restarted, or another took its place."""
        if self._origin is not None:
            self.resets += 1
        self._start()

    def has_restarted(self, tick: int, arrival: int) -> bool:
        """Whether a tick cannot follow the last one without a restart of the device."""
        return self._origin is not None and self._advance(tick, arrival) < 0

    def stamp(self, tick: int, arrival: int) -> int:
        """Return the ROS time [ns] at which the device read `tick`; `arrival` is ROS time [ns]."""
        return self.settle([self.observe(tick, arrival)])[0]

    def observe(self, tick: int, arrival: int) -> Observation:
        """Take in a sample's tick and arrival; `settle` gives its stamp."""
        advance = 0 if self._origin is None else self._advance(tick, arrival)
        if advance < 0:
            self.restart()
        elif arrival < self._arrival - STEP_S * SECOND_NS:
            self.steps += 1
            self._start()
            self._last_stamp = 0
        if self._origin is None:
            self._origin = arrival
        else:
            self.wraps += (self._tick + advance) // TICK_RANGE
            self._elapsed += advance
        self._tick = tick
        self._arrival = arrival
        time = self._elapsed / self.tick_rate
        offset = (arrival - self._origin) / SECOND_NS - time
        self._active.add(time, offset)
        self._pending.add(time, offset)
        if time >= self._switch_at:
            self._pending.slope = self._active.slope
            self._active, self._pending = self._pending, ConvexHull()
            self._pending.add(time, offset)
            self._switch_at = time + self.window
        return Observation(
            tick=tick,
            arrival=arrival,
            origin=self._origin,
            elapsed=self._elapsed,
            time=time,
            offset=offset,
        )

    def settle(self, observations: list[Observation]) -> list[int]:
        """Return the stamps [ns] of samples observed since the last call, in order.

        Observe all samples of one chunk before settling any: the last of a backlog was delayed
        least and determines the line best.
        """
        if not observations:
            return []
        line = self._active.line()
        if self._host_clock_stepped(observations[-1], line):
            self._start()
            observations = [self.observe(o.tick, o.arrival) for o in observations]
            line = self._active.line()
        x, y, slope = line
        stamps = []
        for item in observations:
            estimate = item.offset
            if item.origin == self._origin:
                estimate = min(y + slope * (item.time - x), item.offset)
                self._update_residual(item.offset - estimate)
            stamp = (
                item.origin
                + item.elapsed * SECOND_NS // int(self.tick_rate)
                + round((estimate - self.latency) * SECOND_NS)
            )
            self._last_stamp = max(stamp, self._last_stamp + 1)
            stamps.append(self._last_stamp)
        return stamps

    def _host_clock_stepped(self, newest: Observation, line: tuple[float, float, float]) -> bool:
        """Whether the delay has jumped and stayed so; a congested line delays gradually more."""
        x, y, slope = line
        if newest.offset - (y + slope * (newest.time - x)) < STEP_S:
            self._jumped_at = math.inf
        elif newest.offset - self._last_offset > STEP_S:
            self._jumped_at = newest.time
        self._last_offset = newest.offset
        if newest.time - self._jumped_at <= STEP_DURATION_S:
            return False
        self.steps += 1
        return True

    @property
    def age(self) -> float:
        """Device time since its first sample [s]."""
        return self._elapsed / self.tick_rate

    @property
    def skew_ppm(self) -> float:
        """How much faster than ROS time the device's clock runs [ppm]."""
        if not self._active.points:
            return 0.0
        return 0.0 - 1e6 * self._active.line()[2]

    def _advance(self, tick: int, arrival: int) -> int:
        """Return the ticks since the last one; negative where the device restarted."""
        advance = (tick - self._tick + HALF_RANGE) % TICK_RANGE - HALF_RANGE
        # After a silence of more than half its range the host's clock tells how often it wrapped.
        waited = (arrival - self._arrival) / SECOND_NS * self.tick_rate
        return advance + TICK_RANGE * round(max(waited - abs(advance), 0.0) / TICK_RANGE)

    def _update_residual(self, delay: float) -> None:
        weight = RESIDUAL_WEIGHT
        difference = delay - self._residual_mean
        self._residual_mean += weight * difference
        self._residual_variance += weight * (difference**2 - self._residual_variance)
        self.residual = self._residual_variance**0.5
