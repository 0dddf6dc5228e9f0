# SPDX-License-Identifier: Apache-2.0
"""The error of an autopilot's curve of one log on the other logs of the same device.

Each power-on has a level of its own, which no curve knows: errors are about the level of the log
they are taken on, at temperatures that the curve was fitted to.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import INERTIAL_SENSORS, Sensor
from thermal_comp.second_opinion.opinion import SecondOpinion

LEAST_COMMON_K = 3.0
"""Range of temperature that two logs have to share [K]."""


@dataclass(frozen=True, eq=False)
class OtherLogs:
    """Errors of the curves of a sensor on other logs than their own, rms per axis, (3,) [unit]."""

    pairs: int
    """Number of curves times the other logs that share temperatures with each."""
    raw: FloatArray
    """Before anything is subtracted."""
    left: FloatArray
    """With the curve of another log."""
    own: FloatArray
    """With the curve of the rest of the same log, held out."""


def on_other_logs(opinions: Sequence[SecondOpinion]) -> Mapping[Sensor, OtherLogs]:
    """Return the errors of the curves of a device on its other logs, by sensor."""
    found = {}
    for sensor in INERTIAL_SENSORS:
        known = [opinion for opinion in opinions if sensor in opinion.sensors]
        errors = [
            squares
            for one, other in itertools.permutations(known, 2)
            if (squares := _squares(one, other, sensor)) is not None
        ]
        if errors:
            raw, left = (np.concatenate(part) for part in zip(*errors, strict=True))
            own = np.stack([opinion.sensors[sensor].held_out for opinion in known])
            found[sensor] = OtherLogs(
                pairs=len(errors),
                raw=np.sqrt(raw.mean(axis=0)),
                left=np.sqrt(left.mean(axis=0)),
                own=np.sqrt((own**2).mean(axis=0)),
            )
    return found


def _squares(
    one: SecondOpinion, other: SecondOpinion, sensor: Sensor
) -> tuple[FloatArray, FloatArray] | None:
    """Return (m, 3) squared errors of the blocks of `other`, raw and with the curve of `one`."""
    cubic, run = one.sensors[sensor].cubic, other.run
    measured = run.measured[sensor]
    seen = np.isfinite(measured).all(axis=1)
    seen &= (run.temperature >= cubic.low) & (run.temperature <= cubic.high)
    if not seen.any() or np.ptp(run.temperature[seen]) < LEAST_COMMON_K:
        return None
    before = measured[seen]
    after = before - cubic.error(run.temperature[seen])
    return (before - before.mean(axis=0)) ** 2, (after - after.mean(axis=0)) ** 2
