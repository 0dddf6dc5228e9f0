# SPDX-License-Identifier: Apache-2.0
"""A filter fed with samples as they arrive: pairing, mounting, state, statistics; without ROS."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable
from math import isfinite, nan
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from imu_recording.jit import entry_of
from imu_recording.ros.messages import Covariance, ImuSample, MagneticSample
from numba.typed import List

from orientation_filters.filters import FilterError, check_cutoff, module
from orientation_filters.kernel import kernel
from orientation_filters.live.magnetometer_pairing import MagnetometerPairing, Pair
from orientation_filters.parameters import FilterParameters
from orientation_filters.result import (
    BIAS_LIMITED,
    DISTURBED,
    DROPPED,
    FLAGS,
    JAMMED,
    JUMPED_BACK,
    NOT_STARTED,
    REINITIALISED,
    SIX_AXIS,
    Estimate,
    flag_names,
)
from orientation_filters.rotation.arrays import IDENTITY, rotate, to_matrix
from orientation_filters.rotation.scalars import euler_zyx
from orientation_filters.sample_checks import GRAVITY, NO_FIELD, Sample

LEAST_RATE_INTERVALS = 20
"""Intervals from which the sample rate is known well enough to check the cut-off."""
RECENT_SAMPLES = 500
"""Samples over which rate, jitter and disturbed fraction are taken."""


class LiveEstimate(NamedTuple):
    """The attitude at one sample."""

    sample: ImuSample
    """In the axes of the body."""
    orientation: tuple[float, float, float, float]
    """xyzw, body → world."""
    covariance: Covariance
    """Nine numbers about the world's axes [rad²]."""
    flags: int

    @property
    def euler(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw (ZYX) [rad]."""
        return euler_zyx(self.orientation)


@kernel
def hold(value: Any) -> Any:
    """Return a list in compiled memory that holds the value alone."""
    holder = List()
    holder.append(value)
    return holder


@kernel
def held(holder: Any) -> Any:
    """Return the value of a holder as Python's tuples."""
    return holder[0]


class CompiledState:
    """State and parameters of a filter module that has a `step`, kept in compiled memory.

    Passing a state of 170 numbers to the kernel and back as Python tuples takes ten times as long
    as the update itself; here only samples and estimates pass.
    """

    def __init__(self, module: ModuleType, params: Any) -> None:
        self._kernel = module.step
        self._step: Callable[..., Any] = self._first_step
        self._states = hold(module.initial_state())
        self.set_params(params)

    def _first_step(self, *arguments: Any) -> Any:
        found = self._kernel(*arguments)
        self._step = entry_of(self._kernel, arguments)
        return found

    def set_params(self, params: Any) -> None:
        """Take over parameters; the state goes on."""
        self._params = hold(params)

    def update(self, sample: Sample) -> Estimate:
        """Return the estimate after a sample."""
        return Estimate(*self._step(self._states, self._params, *sample))

    @property
    def state(self) -> Any:
        """The module's State."""
        return held(self._states)


class PlainState:
    """State and parameters of a filter module in plain Python."""

    def __init__(self, module: ModuleType, params: Any) -> None:
        self._update = module.update
        self.state = module.initial_state()
        self._params = params

    def set_params(self, params: Any) -> None:
        """Take over parameters; the state goes on."""
        self._params = params

    def update(self, sample: Sample) -> Estimate:
        """Return the estimate after a sample."""
        found: Estimate
        self.state, found = self._update(self.state, self._params, sample)
        return found


def live_state(module: ModuleType, params: Any) -> CompiledState | PlainState:
    """Return the state of a filter module before its first sample."""
    return (CompiledState if hasattr(module, 'step') else PlainState)(module, params)


class SampleStatistics:
    """Counts of flags, recent flags, and intervals between samples."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._recent: deque[int] = deque(maxlen=RECENT_SAMPLES)
        self._intervals: deque[int] = deque(maxlen=RECENT_SAMPLES)
        self._last_stamp: int | None = None

    def add(self, stamp: int, flags: int) -> None:
        """Count a sample and its flags."""
        self._recent.append(flags)
        self.counts['samples'] += 1
        for name in flag_names(flags):
            self.counts[name] += 1
        if flags & DROPPED:
            return
        if self._last_stamp is not None and not flags & JUMPED_BACK:
            self._intervals.append(stamp - self._last_stamp)
        self._last_stamp = stamp

    @property
    def last_flags(self) -> int | None:
        """Flags of the last sample; None before the first."""
        return self._recent[-1] if self._recent else None

    @property
    def knows_rate(self) -> bool:
        """Whether there are intervals enough to compare the sample rate with a cut-off."""
        return len(self._intervals) >= LEAST_RATE_INTERVALS

    @property
    def rate_hz(self) -> float:
        """Median sample rate [Hz]."""
        return 1e9 / float(np.median(self._intervals)) if self._intervals else nan

    @property
    def jitter_ms(self) -> float:
        """Standard deviation of the intervals [ms]."""
        return float(np.std(self._intervals)) * 1e-6 if self._intervals else nan

    @property
    def disturbed_fraction(self) -> float:
        """Fraction of recent samples whose magnetic field was rejected."""
        disturbed = [flags & (DISTURBED | JAMMED) != 0 for flags in self._recent]
        return float(np.mean(disturbed)) if disturbed else 0.0


class LiveFilter:
    """Feeds `update` of one filter, sample by sample, and keeps statistics."""

    def __init__(self, name: str, parameters: FilterParameters, *, in_order: bool = False) -> None:
        self.name = name
        self.refusal = ''
        """Why nothing is estimated; '' while all is well."""
        self._parameters = parameters
        self._module = module(name, parameters)
        self._compile()
        self._state = live_state(self._module, parameters.kernel_params())
        self._pairing = MagnetometerPairing(
            use_magnetometer=parameters.use_magnetometer, in_order=in_order
        )
        mount = np.array(parameters.mount)
        self._mount = None if np.array_equal(mount, IDENTITY) else mount / np.linalg.norm(mount)
        self._statistics = SampleStatistics()
        self._is_cutoff_checked = False

    def _compile(self) -> None:
        """Call the kernels once, so that loading them delays neither samples nor diagnostics."""
        sample = Sample(1, (0.0, 0.0, 0.0), (0.0, 0.0, GRAVITY), (2e-5, 0.0, -4e-5))
        state = live_state(self._module, self._parameters.kernel_params())
        state.update(sample)
        tuple(state.state.bias)  # as diagnostics read it

    def set_parameters(self, parameters: FilterParameters) -> None:
        """Take over parameters that changed; the state goes on."""
        if self._statistics.knows_rate:
            check_cutoff(parameters, self._statistics.rate_hz)
        self._parameters = parameters
        self._state.set_params(parameters.kernel_params())

    def add_imu(self, sample: ImuSample) -> list[LiveEstimate]:
        """Take an IMU sample; return the attitudes that are known now."""
        return self._estimates(self._pairing.add_imu(sample))

    def add_field(self, sample: MagneticSample) -> list[LiveEstimate]:
        """Take a magnetometer sample; return the attitudes that are known now."""
        if not all(isfinite(v) for v in sample.magnetic_field):
            self._statistics.counts['invalid_magnetometer'] += 1
            return []
        return self._estimates(self._pairing.add_field(sample))

    def flush(self) -> list[LiveEstimate]:
        """Return the attitudes of samples that still waited for a magnetometer sample."""
        return self._estimates(self._pairing.flush())

    def _estimates(self, pairs: Iterable[Pair]) -> list[LiveEstimate]:
        found = []
        for imu, field in pairs:
            estimate = self._estimate(imu, field)
            if estimate is not None:
                found.append(estimate)
        return found

    def _estimate(self, imu: ImuSample, field: MagneticSample | None) -> LiveEstimate | None:
        """Return the attitude after a pair of samples, None where there is none."""
        m = NO_FIELD if field is None else field.magnetic_field
        if self._mount is not None:
            imu, m = _mounted(imu, m, self._mount)
        sample = Sample(imu.stamp, imu.angular_velocity, imu.linear_acceleration, m)
        found = self._state.update(sample)
        self._statistics.add(imu.stamp, found.flags)
        if not self._is_cutoff_checked and self._statistics.knows_rate:
            self._check_cutoff()
        if found.flags & (DROPPED | NOT_STARTED) or self.refusal:
            return None
        xx, xy, xz, yy, yz, zz = found.covariance
        return LiveEstimate(
            sample=imu,
            orientation=found.orientation,
            covariance=(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            flags=found.flags,
        )

    def _check_cutoff(self) -> None:
        """Refuse a cut-off above half the sample rate, once the rate is known."""
        self._is_cutoff_checked = True
        try:
            check_cutoff(self._parameters, self._statistics.rate_hz)
        except FilterError as error:
            self.refusal = str(error)

    def status(self) -> tuple[int, str, dict[str, Any]]:
        """Return level (0 ok, 1 warn, 2 error), one line, and values."""
        statistics = self._statistics
        values = {
            'filter': self.name,
            'preset': self._parameters.preset,
            'rate_hz': statistics.rate_hz,
            'jitter_ms': statistics.jitter_ms,
            'disturbed_fraction': statistics.disturbed_fraction,
            **dict(zip(('bias_x', 'bias_y', 'bias_z'), self._state.state.bias, strict=True)),
            'resets': max(statistics.counts['reinitialised'] - 1, 0),
            'exact_pairs': self._pairing.exact,
            'unused_magnetometer_samples': self._pairing.unused,
            **{name: statistics.counts[name] for _, (name, _) in FLAGS.items()},
        }
        if self.refusal:
            return 2, self.refusal, values
        if statistics.last_flags is None:
            return 0, 'waiting for samples', values
        return *_status_of(statistics.last_flags, self._parameters.use_magnetometer), values


def _status_of(flags: int, use_magnetometer: bool) -> tuple[int, str]:
    """Return level and line for the flags of the last sample."""
    if flags & NOT_STARTED:
        return 1, 'no usable specific force yet'
    if flags & SIX_AXIS and use_magnetometer:
        return 1, 'no magnetometer: heading from the gyroscope alone'
    if flags & (DISTURBED | JAMMED):
        return 1, 'magnetic disturbance: heading from the gyroscope alone'
    if flags & BIAS_LIMITED:
        return 1, 'rate at rest above bias_limit: not learned as bias'
    if flags & DROPPED:
        return 1, 'last sample dropped'
    if flags & REINITIALISED:
        return 0, 'attitude set anew'
    return 0, 'estimating'


def _mounted(
    imu: ImuSample, m: tuple[float, float, float], q: np.ndarray
) -> tuple[ImuSample, tuple[float, float, float]]:
    """Return a sample and field in the axes of the body."""
    w, f, b = rotate(q, np.array([imu.angular_velocity, imu.linear_acceleration, m])).tolist()
    return imu._replace(
        angular_velocity=(w[0], w[1], w[2]),
        linear_acceleration=(f[0], f[1], f[2]),
        angular_velocity_covariance=_turned(imu.angular_velocity_covariance, q),
        linear_acceleration_covariance=_turned(imu.linear_acceleration_covariance, q),
    ), (b[0], b[1], b[2])


def _turned(covariance: Covariance, q: np.ndarray) -> Covariance:
    """Return a covariance in the axes of the body; unknown and unreported stay as they are."""
    if covariance[0] == -1.0 or not any(covariance):
        return covariance
    r = to_matrix(q)
    return tuple((r @ np.reshape(covariance, (3, 3)) @ r.T).ravel().tolist())
