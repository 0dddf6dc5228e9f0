# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis may find that is no effect with columns: in words, as `explain` prints them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class FindingExplanation:
    """One finding in words."""

    name: str
    summary: str
    kind: str
    """As in the findings of a diagnosis."""
    seen: str
    """What in the recordings speaks for it."""
    mechanism: str
    separation: str
    """How to tell it from what looks like it."""
    remedy: str
    reference: str

    def to_dict(self) -> dict[str, str]:
        """Return plain values."""
        return asdict(self)

    def text(self) -> str:
        """Return the finding as lines for the terminal."""
        rows = (
            ('found as', self.kind),
            ('seen in', self.seen),
            ('mechanism', self.mechanism),
            ('to tell', self.separation),
            ('what to do', self.remedy),
            ('reference', self.reference),
        )
        return '\n'.join([f'{self.name}: {self.summary}', *(f'  {a:<12} {b}' for a, b in rows)])


_LISTED = (
    FindingExplanation(
        'clock_temperature',
        'The sampling interval changes with temperature.',
        'clock',
        'the interval between stamps, means over windows, against the die temperature [1/K]',
        'The RC oscillator that paces the output has a temperature coefficient, 10–100 ppm/K.',
        'No trace in static means; it turns integrated angles and moves aliased lines.',
        'stamp the samples by the host, or scale the interval by temperature',
        'IEEE 1431 (scale factor of an integrating sensor contains its clock)',
    ),
    FindingExplanation(
        'random_walk',
        'A bias walks at random, differently in every run and axis.',
        'noise',
        'slow noise that exceeds the reference by far more than the fast noise does',
        'Rate random walk: a stochastic process, no function of any condition.',
        'A drift or a creep is the same in every run, a walk never.',
        'nothing to compensate: compare with another unit (--noise-reference MODEL)',
        'IEEE 952 and 647 (rate random walk, Allan deviation of slope +1/2)',
    ),
    FindingExplanation(
        'saturation',
        'Values are clipped at the end of the range.',
        'data_quality',
        'one extreme value that is there several times as often as the steps just inside it',
        'Full scale too narrow for gravity, vibration or a magnet nearby; the mean is biased '
        'before it reaches the rail.',
        'A stuck value stands anywhere and does not scatter; a clipped one stands at an extreme.',
        'choose a wider full scale or remove the magnet; the rows are left out',
        'LSM9DS1 datasheet (full scales and sensitivities)',
    ),
    FindingExplanation(
        'stuck_value',
        'A sensor repeats one value while time goes on.',
        'data_quality',
        'rows equal on all axes for 4 s and more, longer than quantised noise repeats by chance',
        'A register is read again without new data, or the bus returns the last answer.',
        'Coarse counts repeat by chance: the more, the less noise per count; that is allowed for.',
        'check bus and driver; the rows are left out',
        'LSM9DS1 datasheet (data-ready bits)',
    ),
    FindingExplanation(
        'spikes',
        'Single values lie far from their neighbours.',
        'data_quality',
        'single rows of one axis 9 σ and more off both neighbours (14 σ for rows slower than 2 s)',
        'Bit and bus errors, broken lines of a serial stream, knocks.',
        'A knock is felt by several axes and rings; a bit error is one row of one axis.',
        'check bus and cable; the rows are left out',
        'σ as 1.4826 times the median absolute deviation (Hampel)',
    ),
    FindingExplanation(
        'startup_transient',
        'The first samples of every channel miss the same share of their level.',
        'data_quality',
        'a common factor below one, over all channels that stand above their noise, that '
        'rises to one',
        'A filter that started at zero and fills up, or first samples averaged with zeros.',
        'A warm-up moves each channel by an amount of its own; neither temperature nor motion '
        'scales gravity and field alike.',
        'nothing: the first rows are cut',
        'Betta et al. 2022, Tables III–V (minima at 0.53 of the mean)',
    ),
    FindingExplanation(
        'thermometer_missing',
        'Rows hold no temperature.',
        'data_quality',
        'NaN where other channels have values',
        'The register was not read, or the logger was not told to log it.',
        "A rate below the samples' own is none: the newest value is held.",
        'log the temperature at one hertz or more; rows without it fit nothing',
        'LSM9DS1 datasheet (OUT_TEMP)',
    ),
    FindingExplanation(
        'thermometer_constant',
        'The temperature is always the same while time or the chamber goes on.',
        'data_quality',
        'one value throughout, or for long while the chamber changes by more than 5 K',
        'A default value of the driver, or a register that is read once.',
        'A device in a room of steady temperature still varies by counts.',
        'check the driver; nothing over temperature can be fitted to these rows',
        'seen in logs of autopilots',
    ),
    FindingExplanation(
        'thermometer_whole_degrees',
        'The temperature comes in whole degrees.',
        'data_quality',
        'no reading lies between two kelvins',
        'The driver casts to an integer.',
        'An LSM9DS1 counts 1/16 K.',
        'log it as it comes: slopes hold, what follows the rate of change drowns in steps',
        'LSM9DS1 datasheet (temperature sensitivity)',
    ),
    FindingExplanation(
        'thermometer_copied',
        "The temperature is another sensor's.",
        'data_quality',
        'bit for bit the values of chamber or board nine times of ten',
        'A mapping that names one column twice, or a driver that falls back on another sensor.',
        'Two thermometers never agree to the last bit while the temperature moves.',
        "log the die's own; else what lies between the two is fitted as a lag",
        'seen in logs of autopilots',
    ),
    FindingExplanation(
        'thermometer_scale',
        'The die seems to move far more or less than what is around it.',
        'data_quality',
        'kelvins of the die per kelvin around it outside 0.7 … 1.4, lags allowed for',
        'A wrong sensitivity in the driver (16 counts for 256), or °F taken for °C.',
        'Self-heating adds a constant, not a factor.',
        'mend the scale; slopes fitted to it hold for it alone',
        'LSM9DS1 datasheet (16 LSB/K)',
    ),
    FindingExplanation(
        'coarse_clock',
        'Stamps come in steps nearly as long as the distance of the samples.',
        'data_quality',
        'uneven intervals that are whole multiples of 1, 10, 100 or 1000 ms',
        'The host stamps in milliseconds, or a timer ticks slowly.',
        'Jitter of a scheduler is no multiple of anything.',
        'stamp in microseconds; angles integrated over such stamps are noisy',
        'seen in logs of autopilots',
    ),
    FindingExplanation(
        'orientation_flip',
        'Gravity changes its direction within a run.',
        'data_quality',
        'a step of the specific force that lasts, after which another axis points up, or the '
        'same one the other way',
        'The device was turned or fell over, or a sign is wrong in a part of the data.',
        'A tilt with temperature is a fraction of a degree and returns with it.',
        'nothing: every part at rest is a run of its own, each with its axis up',
        'REP-145 (orientation of an IMU at rest)',
    ),
    FindingExplanation(
        'moved',
        'The device was moved for a short while.',
        'data_quality',
        'three seconds and more in which specific force is 5 % of gravity off the minute around '
        'them, or the field is turned by ten degrees as the gyroscope says; or a step by as much '
        'that lasts and leaves the norm',
        'It was picked up, knocked over or carried; afterwards it may stand otherwise, so that '
        'every level is another one.',
        'A knock lasts for less; a step of the sensor itself comes without motion.',
        'nothing: every part at rest is a run of its own; one below 5 % of the recording is left '
        'out',
        'REP-145 (an IMU at rest shows gravity)',
    ),
    FindingExplanation(
        'unit_mismatch',
        'One sensor is logged in another unit than the rest, or than SI.',
        'data_quality',
        'a norm that is gravity, the field or the noise of the class only in another unit '
        '(g, °/s, µT, mG)',
        'A driver that does not convert, or a file put together from several.',
        'A scale factor error is a few per cent; units differ by 9.8, 57, 10⁴ or 10⁶.',
        'convert to SI units before',
        'REP-103 (SI units), sensor_msgs/Imu and MagneticField',
    ),
    FindingExplanation(
        'impossible_statistic',
        'A channel or a table holds what cannot be.',
        'data_quality',
        'a mean outside its range, a σ larger than the range allows, a negative variance, a '
        'humidity of 24',
        'A misprint, columns mixed up, a percentage taken for a share.',
        'The bound of Popoviciu and of Bhatia and Davis leaves no other reading of σ and range.',
        'check what was logged; the track is left out',
        'Bhatia and Davis, A Better Bound on the Variance, 2000',
    ),
)

FINDINGS: Mapping[str, FindingExplanation] = {finding.name: finding for finding in _LISTED}
"""Name → what it is."""
