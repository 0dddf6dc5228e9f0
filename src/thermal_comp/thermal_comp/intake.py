# SPDX-License-Identifier: Apache-2.0
"""From recordings to what a diagnosis needs of them, one at a time to save memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import ImuRecording

from thermal_comp.clock_temperature import ClockFinding, clock_windows, slope_of_windows
from thermal_comp.data_quality import QualityFinding, check_recording, merged, wrong_units
from thermal_comp.data_quality_units import scales_of
from thermal_comp.diagnose_noise import bandwidth_known
from thermal_comp.preparation import PERIOD, prepare_run, run_name
from thermal_comp.prepared_run import PreparedRun


@dataclass(frozen=True, eq=False)
class Intake:
    """What a diagnosis needs of the recordings of one device."""

    runs: list[PreparedRun]
    """Without the rows that are defective."""
    defects: list[QualityFinding]
    clock: ClockFinding | None
    bandwidth_known: bool
    """Whether white noise may be judged."""


def take_in(recordings: Iterable[ImuRecording], *, period: float = PERIOD) -> Intake:
    """Return what is needed of recordings that may be read one after the other.

    The next one is read while one is checked and averaged; none is kept.
    """
    runs: list[PreparedRun] = []
    findings: list[QualityFinding] = []
    names, scales, windows, known = [], [], [], []
    taken: dict[str, int] = {}
    for number, recording in enumerate(_read_ahead(recordings), 1):
        names.append(recording.run or str(number))
        windows.append(clock_windows(recording))
        known.append(bandwidth_known([recording]))
        clean, found = check_recording(recording, names[-1])
        findings += found
        scales.append(scales_of(clean))
        runs.append(prepare_run(clean, run_name(recording, number, taken), period=period))
    for number, finding in wrong_units(scales, names, findings):
        findings.append(replace(finding, rows=len(runs[number].conditions)))
        runs[number] = _without(runs[number], finding)
    return Intake(runs, merged(findings), slope_of_windows(windows), all(known))


def _read_ahead(recordings: Iterable[ImuRecording]) -> Iterator[ImuRecording]:
    """Yield the recordings; those that are still to be read are read by a thread of their own."""
    if isinstance(recordings, Sequence):
        yield from recordings
        return
    source = iter(recordings)
    with ThreadPoolExecutor(max_workers=1) as reader:
        ahead = reader.submit(next, source, None)
        while (recording := ahead.result()) is not None:
            ahead = reader.submit(next, source, None)
            yield recording
            del recording


def _without(run: PreparedRun, finding: QualityFinding) -> PreparedRun:
    """Return the run as if one sensor had not been logged."""
    unknown = {
        s: np.full_like(values, np.nan)
        for s, values in run.measured.items()
        if s == finding.sensor
    }
    fine = {s: np.full_like(run.fine_measured[s], np.nan) for s in unknown}
    conditions = run.conditions
    if finding.sensor == 'magnetometer':
        nowhere = np.full_like(conditions.magnetic_field, np.nan)
        conditions = replace(conditions, magnetic_field=nowhere)
    return replace(
        run,
        conditions=conditions,
        measured={**run.measured, **unknown},
        fine_measured={**run.fine_measured, **fine},
    )
