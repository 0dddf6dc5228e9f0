# SPDX-License-Identifier: Apache-2.0
"""Subtract the modelled error, sample by sample as they come."""

from __future__ import annotations

import math
from bisect import insort
from dataclasses import dataclass, field, replace
from operator import add
from typing import Any, NamedTuple

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.ros.messages import ImuSample, MagneticSample
from imu_recording.stream_plausibility import JUMP_BACK_NS

from thermal_comp.compensation.recording import (
    DEFAULT_EXTRAPOLATION,
    OUTSIDE_THE_RANGE,
    TIMEOUT_S,
    Extrapolation,
    SensorError,
    SensorPlan,
    depends_on_time,
    has_history,
    plan_of,
    sensor_error,
)
from thermal_comp.data.binning import VibrationState, update_vibration
from thermal_comp.data.conditions import (
    CHANNELS,
    SENSORS,
    Conditions,
    Sensor,
    settled_conditions,
)
from thermal_comp.effects.effect import State
from thermal_comp.model.values import ThermalModel

Vector = tuple[float, float, float]

REMEMBERED_TEMPERATURES = 4096
"""Errors of a sensor that are kept by temperature: 256 K in counts of 1/16 K."""
REMEMBERED_VALUES = 64
"""Values of a channel that are remembered for samples that arrive late."""
NOT_REPORTED = -1.0
"""First element of the covariance of a measurement that is not there (REP-145)."""

Histories = dict[Sensor, tuple[State | None, ...]]


class CompensatedVector(NamedTuple):
    """One compensated measurement."""

    value: Vector
    covariance: FloatArray
    """(3, 3) of what the model adds to the sensor's own noise [unit²]."""
    noise_variance: FloatArray
    """(3,) of the sensor's own noise, as the model knows it; zero where it does not [unit²]."""
    compensated: bool
    """False where the measurement was passed on as it came."""


class _Prepared(NamedTuple):
    """The error of one sensor at one temperature."""

    error: tuple[float, ...]
    """x, y, z [unit]."""
    covariance: FloatArray
    """(3, 3) [unit²]."""
    outside: bool


@dataclass
class Condition:
    """What diagnostics report about a compensator's work, counted since the start."""

    samples: int = 0
    passed_on: int = 0
    """Samples without a fresh temperature."""
    extrapolated: int = 0
    """Samples outside the fitted range."""
    stale: bool = False
    """Whether the newest sample had no fresh temperature."""
    outside: bool = False
    """Whether the newest sample was outside the fitted range."""
    temperature: float = math.nan
    """[°C] used for the newest sample."""
    not_applied: dict[str, str] = field(default_factory=dict)
    """Effects that could not be applied to the newest sample: the channel each one needs."""
    history: str = 'not needed'
    """'not needed', 'kept', 'restored' or 'lost'."""


class Compensator:
    """Compensates a stream of one device; feed temperatures before samples of the same stamp."""

    def __init__(
        self,
        model: ThermalModel,
        *,
        temperature_timeout: float = TIMEOUT_S,
        extrapolation: Extrapolation = DEFAULT_EXTRAPOLATION,
    ) -> None:
        self.model = model
        self._outside = OUTSIDE_THE_RANGE[extrapolation]
        known = [s for s in SENSORS if s in model.sensors]
        self._plans = {s: plan_of(model.sensors[s], extrapolation) for s in known}
        self._errors: dict[Sensor, dict[float, _Prepared]] = {s: {} for s in known}
        """By temperature, of sensors whose error depends on it alone: its counts recur."""
        self._needs_vibration = 'vibration' in self.channels
        self._noise_of: dict[tuple[Sensor, int], FloatArray] = {}
        self._noise_key = _noise_key(math.nan)
        self.timeout_ns = round(temperature_timeout * 1e9)
        self.condition = Condition(history='lost' if _needs_history(model) else 'not needed')
        self.applied_before = ''
        """Model that was subtracted from what comes; then nothing is subtracted here."""
        self.origin = -1
        self.newest = -1
        self.histories: Histories = {}
        self.vibration = VibrationState()
        self._before_row: tuple[State | None, ...] | None = None
        self._channels: dict[str, list[tuple[int, float | Vector]]] = {}
        self._force: Vector = (math.nan,) * 3
        self._rate: Vector = (math.nan,) * 3
        self._field: Vector = (math.nan,) * 3

    @property
    def channels(self) -> set[str]:
        """Channels beyond the die temperature that the model's device effects need."""
        return {
            channel
            for sensor in self.model.sensors.values()
            for _, effect, _ in sensor.device_terms()
            for channel in effect.needs
        }

    def report(self) -> tuple[int, str, dict[str, Any]]:
        """Return level (0 ok, 1 warn, 2 error), one line and values for diagnostics."""
        now = self.condition
        warnings = [
            ('no model: data pass through unchanged', not self.model.sensors),
            ('no fresh temperature: data pass through unchanged', now.samples and now.stale),
            (
                f'{now.temperature:.1f} °C is outside the fitted range: {self._outside}',
                now.outside,
            ),
            (f'not applied: {", ".join(now.not_applied)}', bool(now.not_applied)),
            ('history lost', now.history == 'lost'),
        ]
        said = [text for text, true in warnings if true]
        if self.applied_before:
            done = f'compensated already ({self.applied_before})'
            said = [f'{done}: data pass through unchanged; parameter again compensates them']
        values = {**vars(now), 'device': self.model.device}
        values['not_applied'] = '; '.join(f'{e} needs {c}' for e, c in now.not_applied.items())
        return (
            2 if self.applied_before else int(bool(said)),
            '; '.join(said) or ('compensating' if now.samples else 'waiting for samples'),
            values,
        )

    def on_temperature(self, stamp: int, temperature: float) -> None:
        """Take in a die temperature [°C] measured at `stamp` [ns]."""
        if math.isfinite(temperature):
            self.on_channel('temperature', stamp, temperature)

    def on_channel(self, name: str, stamp: int, value: float | Vector) -> None:
        """Take in a value of a channel of Conditions, measured at `stamp` [ns]."""
        values = self._channels.setdefault(name, [])
        if not values or stamp >= values[-1][0]:
            values.append((stamp, value))
        else:
            insort(values, (stamp, value), key=lambda item: item[0])
        if len(values) > REMEMBERED_VALUES:
            del values[0]

    def on_imu(
        self, stamp: int, angular_velocity: Vector, linear_acceleration: Vector
    ) -> tuple[CompensatedVector, CompensatedVector]:
        """Return compensated angular velocity and linear acceleration of one sample."""
        if self.newest >= 0 and stamp < self.newest - JUMP_BACK_NS:
            self._restart(stamp)
        if self.origin < 0:
            self.origin = stamp
        in_order = stamp > self.newest
        if in_order:
            interval = (stamp - self.newest) * 1e-9 if self.newest >= 0 else math.nan
            self._noise_key = _noise_key(interval)
            self.newest = stamp
            if self._needs_vibration:
                self.vibration = update_vibration(
                    self.vibration, stamp, linear_acceleration, self.origin
                )
        self._rate, self._force = angular_velocity, linear_acceleration
        self.condition.samples += 1
        gyroscope = self._compensate('gyroscope', stamp, angular_velocity, keep=in_order)
        self.condition.passed_on += self.condition.stale
        self.condition.extrapolated += self.condition.outside
        accelerometer = self._compensate(
            'accelerometer', stamp, linear_acceleration, keep=in_order
        )
        if in_order and self.condition.history != 'not needed':
            # The magnetometer's history advances with the rows, as in a recording.
            self._before_row = self.histories.get('magnetometer')
            self._compensate('magnetometer', stamp, self._field, keep=True)
        return gyroscope, accelerometer

    def on_magnetic_field(self, stamp: int, magnetic_field: Vector) -> CompensatedVector:
        """Return one compensated magnetic field."""
        self._field = magnetic_field
        return self._compensate('magnetometer', stamp, magnetic_field, keep=False)

    def resume(
        self, origin: int, newest: int, histories: Histories, vibration: VibrationState
    ) -> None:
        """Go on where an earlier compensator of the same model stopped."""
        self.origin, self.newest = origin, newest
        self.histories, self.vibration = histories, vibration
        if self.condition.history != 'not needed':
            self.condition.history = 'restored'

    def _restart(self, stamp: int) -> None:
        """Forget the history: the clock jumped back, this is another stream."""
        self.origin, self.newest, self.histories, self._before_row = -1, -1, {}, None
        self.vibration = VibrationState()
        for name, values in self._channels.items():
            self._channels[name] = [item for item in values if item[0] <= stamp]
        if self.condition.history != 'not needed':
            self.condition.history = 'lost'

    def _compensate(
        self, sensor: Sensor, stamp: int, measured: Vector, *, keep: bool
    ) -> CompensatedVector:
        plan = self._plans.get(sensor)
        if plan is None or self.applied_before:
            return CompensatedVector(measured, np.zeros((3, 3)), np.zeros(3), compensated=False)
        temperature = self._value('temperature', stamp, self.timeout_ns)
        self.condition.stale = temperature is None
        if not isinstance(temperature, float):
            unknown = np.diag(plan.variance)
            return CompensatedVector(measured, unknown, self._noise(sensor), compensated=False)
        known = self._errors[sensor].get(temperature)
        if known is None:
            known = self._sample_error(plan, sensor, stamp, temperature, keep=keep)
        self.condition.temperature = temperature
        self.condition.outside = known.outside
        x, y, z = measured
        a, b, c = known.error
        return CompensatedVector(
            (x - a, y - b, z - c), known.covariance, self._noise(sensor), compensated=True
        )

    def _sample_error(
        self, plan: SensorPlan, sensor: Sensor, stamp: int, temperature: float, *, keep: bool
    ) -> _Prepared:
        """Return the error of one sample; keep it where it depends on the temperature alone."""
        found = self._error(plan, sensor, stamp, temperature, keep=keep)
        self._note(plan, found)
        error = tuple(found.error[0].tolist())
        known = _Prepared(error, found.covariance[0], bool(found.outside[0]))
        if plan.temperature_only:
            if len(self._errors[sensor]) >= REMEMBERED_TEMPERATURES:
                self._errors[sensor].clear()
            self._errors[sensor][temperature] = known
        return known

    def _error(
        self, plan: SensorPlan, sensor: Sensor, stamp: int, temperature: float, *, keep: bool
    ) -> SensorError:
        """Return the error of one sample."""
        again = sensor == 'magnetometer' and stamp == self.newest and not keep
        states = self._before_row if again else self.histories.get(sensor)
        found = sensor_error(plan, self._conditions(sensor, stamp, temperature), states)
        if keep and not plan.temperature_only:
            self.histories[sensor] = found.states
        return found

    def _note(self, plan: SensorPlan, found: SensorError) -> None:
        for effect in plan.effects:
            if effect.name in found.skipped:
                self.condition.not_applied[effect.name] = ', '.join(effect.needs)
            elif effect.needs:
                self.condition.not_applied.pop(effect.name, None)

    def _noise(self, sensor: Sensor) -> FloatArray:
        """Return the (3,) noise variance at the newest sample's distance from the one before."""
        key = sensor, self._noise_key
        if key not in self._noise_of:
            noise = self.model.sensors[sensor].noise
            self._noise_of[key] = (
                np.zeros(3) if noise is None else noise.variance_of_means(key[1] * 1e-4)
            )
        return self._noise_of[key]

    def _conditions(self, sensor: Sensor, stamp: int, temperature: float) -> Conditions:
        origin = self.origin if self.origin >= 0 else stamp
        channels: dict[str, Any] = {'vibration': np.array([self.vibration.variance])}
        for name in self._channels:
            if name in CHANNELS and (value := self._value(name, stamp)) is not None:
                channels[name] = np.array([value], dtype=float)
        return Conditions(
            time=np.array([(stamp - origin) * 1e-9]),
            temperature=np.array([temperature]),
            specific_force=np.array([self._force]),
            angular_velocity=np.array([self._rate]),
            magnetic_field=np.array([self._field]),
            sensor=sensor,
            reference_temperature=self.model.reference_temperature,
            **channels,
        )

    def _value(self, name: str, stamp: int, timeout: int | None = None) -> float | Vector | None:
        """Return the newest value not later than `stamp` and not older than `timeout` [ns]."""
        for then, value in reversed(self._channels.get(name, ())):
            if then <= stamp:
                return value if timeout is None or stamp - then <= timeout else None
        return None


def _noise_key(interval: float) -> int:
    """Return an interval between samples [s] in steps of 0.1 ms; 1 s where it is not known."""
    known = interval if math.isfinite(interval) else 1.0
    return round(min(max(known, 1e-4), 100.0) * 1e4)


def _needs_history(model: ThermalModel) -> bool:
    """Tell whether an effect carries a state, or counts the time since power-on."""
    conditions = settled_conditions(model.reference_temperature)
    channels: dict[str, Any] = {n: np.zeros(1) for n in CHANNELS if n != 'vibration'}
    complete = replace(conditions, vibration=np.zeros((1, 3)), **channels)
    known = [s for s in SENSORS if s in model.sensors]
    return any(
        has_history(model.sensors[s], complete.of(s))
        or depends_on_time(model.sensors[s], complete.of(s))
        for s in known
    )


def output_covariance(given: tuple[float, ...], measured: CompensatedVector) -> tuple[float, ...]:
    """Return nine numbers, row-major: the sensor's noise plus the uncertainty of the model.

    `given` is the covariance the measurement came with: kept where it says that there is no
    measurement, taken as the sensor's noise where it is known, else the model's noise is taken.
    """
    if given[0] == NOT_REPORTED:
        return given
    noise = given if any(given) else np.diag(measured.noise_variance).ravel().tolist()
    return tuple(map(add, noise, measured.covariance.ravel().tolist()))


class OutputCovariance:
    """`output_covariance` of one sensor, computed anew only where something has changed."""

    def __init__(self) -> None:
        self._given: tuple[float, ...] = ()
        self._arrays: tuple[FloatArray, ...] = ()
        self._nine_numbers: tuple[float, ...] = ()

    def __call__(self, given: tuple[float, ...], measured: CompensatedVector) -> tuple[float, ...]:
        """Return nine numbers, row-major."""
        known = self._arrays
        if (
            known
            and known[0] is measured.covariance
            and known[1] is measured.noise_variance
            and given == self._given
        ):
            return self._nine_numbers
        self._given, self._arrays = given, (measured.covariance, measured.noise_variance)
        self._nine_numbers = output_covariance(given, measured)
        return self._nine_numbers


class CompensatedSamples:
    """Converts compensated vectors to samples; all their other fields stay."""

    def __init__(self) -> None:
        self._rate, self._force, self._field = (OutputCovariance() for _ in range(3))

    def imu(
        self, sample: ImuSample, rate: CompensatedVector, force: CompensatedVector
    ) -> ImuSample:
        """Return the sample with compensated angular velocity and linear acceleration."""
        return ImuSample(  # `replace` takes five times as long
            sample.stamp,
            rate.value,
            force.value,
            self._rate(sample.angular_velocity_covariance, rate),
            self._force(sample.linear_acceleration_covariance, force),
            sample.frame_id,
            sample.orientation,
            sample.orientation_covariance,
        )

    def field(self, sample: MagneticSample, field: CompensatedVector) -> MagneticSample:
        """Return the sample with the compensated magnetic field."""
        covariance = self._field(sample.magnetic_field_covariance, field)
        return MagneticSample(sample.stamp, field.value, covariance, sample.frame_id)
