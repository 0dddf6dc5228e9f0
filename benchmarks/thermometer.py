# SPDX-License-Identifier: Apache-2.0
"""Faults of thermometer and clock: python benchmarks/thermometer.py [--recordings 200].

Recordings of simulated devices in simulated chambers, as they are and with one seeded fault each:
how many faults are found under their name, and in how many sound recordings something is found.
Exit code 1 where a claim does not hold.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording
from imu_workbench.simulate.campaign import Logging, simulate_campaign
from thermal_comp.data.thermometer import instrument_faults
from verdict import Verdict, judge

Generator = np.random.Generator
FAST_HZ = (59.5, 476.0, 952.0)
STEP_NS = {59.5: 10_000_000, 476.0: 1_000_000, 952.0: 1_000_000}
"""Rate → resolution of a coarse clock that is not finer than a fifth of its interval."""


def missing(recording: ImuRecording, rng: Generator) -> ImuRecording:
    values = recording.temperature.copy()
    length = int(rng.uniform(0.02, 0.3) * len(values))
    first = int(rng.integers(1, len(values) - length))
    values[first : first + length] = np.nan
    return replace(recording, temperature=values)


def constant(recording: ImuRecording, rng: Generator) -> ImuRecording:
    values = recording.temperature.copy()
    first = int(rng.uniform(0.0, 0.3) * len(values)) if rng.random() < 0.5 else 0
    values[first:] = values[first]
    return replace(recording, temperature=values)


def whole(recording: ImuRecording, _: Generator) -> ImuRecording:
    return replace(recording, temperature=np.round(recording.temperature))


def copied(recording: ImuRecording, rng: Generator) -> ImuRecording:
    names = ('chamber_temperature', 'chamber_temperature_2', 'device_temperature')
    track: FloatArray = getattr(recording, names[int(rng.integers(3))])
    return replace(recording, temperature=track.copy())


def scaled(recording: ImuRecording, rng: Generator) -> ImuRecording:
    factor = float(rng.choice([0.1, 0.5, 1.8, 2.0]))
    return replace(recording, temperature=recording.temperature * factor)


def fast(recording: ImuRecording, rng: Generator, *, coarse: bool) -> ImuRecording:
    """Return the rows as of a fast board, under a clock of nanoseconds or of milliseconds."""
    rate = float(rng.choice(FAST_HZ))
    period = 1e9 / rate * (1.0 + rng.uniform(-0.02, 0.02))
    stamp = np.int64(1_600_000_000) * 1_000_000_000 + np.arange(len(recording)) * period
    stamp = np.sort(stamp + rng.normal(0.0, 0.01 * period, len(recording))).astype(np.int64)
    if coarse:
        stamp = stamp // STEP_NS[rate] * STEP_NS[rate]
    kept = np.append(True, np.diff(stamp) > 0)  # a reader leaves repeated stamps out
    return replace(recording, stamp=stamp, temperature_stamp=None).rows(kept)


DAMAGE: dict[str, Callable[[ImuRecording, Generator], ImuRecording]] = {
    'thermometer_missing': missing,
    'thermometer_constant': constant,
    'thermometer_whole_degrees': whole,
    'thermometer_copied': copied,
    'thermometer_scale': scaled,
    'coarse_clock': lambda recording, rng: fast(recording, rng, coarse=True),
}


def sound_recordings(count: int) -> Iterator[ImuRecording]:
    """Yield recordings of three devices: two in three of a 20 min profile, the others of 12 h."""
    for number in range(count):
        long = number % 3 == 2
        (recording,) = simulate_campaign(
            'paper_betta2022' if long else 'short_20min',
            f'dut{1 + number // 3 % 3}',
            Logging(0.1 if long else 1.0, mean=long, chamber_period=10.0 if long else 2.0),
            seed=number,
            orientations=[('+x', '+y', '+z')[number % 3]],
        )
        yield recording


def measure(count: int) -> tuple[Counter[str], Counter[str], int]:
    """Return found and falsely found faults by name, and in how many sound recordings any was."""
    found: Counter[str] = Counter()
    false: Counter[str] = Counter()
    disturbed = 0
    for number, recording in enumerate(sound_recordings(count)):
        rng = np.random.default_rng(number)
        told = [f.name for f in instrument_faults(recording)]
        told += [f.name for f in instrument_faults(fast(recording, rng, coarse=False))
                 if f.name == 'coarse_clock']  # fmt: skip
        false.update(told)
        disturbed += bool(told)
        for name, damage in DAMAGE.items():
            faults = instrument_faults(damage(recording, rng))
            found[name] += any(fault.name == name for fault in faults)
    return found, false, disturbed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--recordings', type=int, default=200)
    count = parser.parse_args().recordings
    found, false, disturbed = measure(count)
    for name in DAMAGE:
        print(f'{name}: {found[name]} of {count} found, {false[name]} false')
    claims = [
        Verdict(f'{name} found', found[name] / count, 0.99, at_least=True) for name in DAMAGE
    ]
    claims.append(Verdict('sound recordings with a fault', disturbed / count, 0.01))
    return 1 if judge(claims) else 0


if __name__ == '__main__':
    sys.exit(main())
