# SPDX-License-Identifier: Apache-2.0
"""From recordings to the inputs of a diagnosis: prepared runs, defects, the sampling clock."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

from thermal_comp.data.blocks import in_common_blocks
from thermal_comp.data.preparation import as_campaign, prepare_run, run_name
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.quality import (
    QualityFinding,
    check_motion,
    check_recording,
    merged,
    scales_of,
    wrong_units,
)
from thermal_comp.diagnosis.noise_level import bandwidth_known

CLOCK_WINDOW_S = 120.0
"""The interval is averaged over this [s]."""
ClockWindows = tuple[FloatArray, FloatArray]
"""(k,) relative sampling interval and (k,) temperature [K], each about its mean."""


@dataclass(frozen=True, eq=False)
class DiagnosisInputs:
    """What a diagnosis needs of the recordings of one device."""

    runs: list[PreparedRun]
    """Without the rows that are defective."""
    defects: list[QualityFinding]
    clock: ClockFinding | None
    bandwidth_known: bool
    """Whether the density of white noise is that of the sensor."""


@dataclass(frozen=True)
class ClockFinding:
    """The device's clock runs at a rate that depends on temperature."""

    slope: float
    """Relative change of the sampling interval per kelvin [1/K]."""
    slope_std: float
    evidence: float
    rms_before: float
    """Rms of the relative interval about its mean [1]."""
    rms_after: float


def prepare_inputs(
    recordings: Iterable[ImuRecording],
    *,
    period: float | None = None,
    prepared: Sequence[PreparedRun] = (),
) -> DiagnosisInputs:
    """Return what is needed of recordings that may be read one after the other.

    The next one is read while one is checked and averaged; none is kept. `prepared`: what
    `prepare` makes of the same recordings; it is taken where nothing is defective.
    """
    runs: list[PreparedRun] = []
    findings: list[QualityFinding] = []
    names, scales, windows, bandwidths = [], [], [], []
    taken: dict[str, int] = {}
    for number, recording in enumerate(_read_ahead(recordings), 1):
        windows.append(clock_windows(recording))
        bandwidths.append(bandwidth_known([recording]))
        parts, found = check_motion(recording, recording.run or str(number))
        findings += found
        for part in parts:
            names.append(part.run or str(number))
            clean, found = check_recording(part, names[-1])
            findings += found
            scales.append(scales_of(clean))
            name = run_name(part, number, taken)
            sound = prepared and clean is recording
            runs.append(prepared[len(runs)] if sound else prepare_run(clean, name, period=period))
        del recording, parts, part, clean  # of long ones each is a third of the memory
    if period is None:
        runs = in_common_blocks(runs)
    for number, finding in wrong_units(scales, names, findings):
        findings.append(replace(finding, rows=len(runs[number].conditions)))
        runs[number] = _without(runs[number], finding)
    if runs != list(prepared):
        runs = as_campaign(runs)
    return DiagnosisInputs(runs, merged(findings), slope_of_windows(windows), all(bandwidths))


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


def clock_windows(recording: ImuRecording) -> ClockWindows | None:
    """Return means over CLOCK_WINDOW_S without gaps of one recording; None where there is none."""
    step = np.diff(recording.stamp) * 1e-9
    if len(step) < 50:
        return None
    usual = float(np.median(step))
    count = max(round(CLOCK_WINDOW_S / usual), 1)
    blocks = len(step) // count
    trimmed = step[: blocks * count].reshape(blocks, count)
    temperature = recording.temperature[: blocks * count].reshape(blocks, count)
    regular = (trimmed < 1.5 * usual).all(axis=1) & np.isfinite(temperature).all(axis=1)
    if not regular.any():
        return None
    relative = trimmed.mean(axis=1)[regular] / usual
    means = temperature.mean(axis=1)[regular]
    return relative - relative.mean(), means - means.mean()


def slope_of_windows(windows: Sequence[ClockWindows | None]) -> ClockFinding | None:
    """Return the slope over the windows of all recordings.

    Δt = Δt₀ (1 + k (T − T̄)); the noise is what the line leaves, with neighbouring windows'
    correlation counted.
    """
    known = [some for some in windows if some is not None]
    if not known:
        return None
    intervals, temperatures = zip(*known, strict=True)
    y, x = np.concatenate(intervals), np.concatenate(temperatures)
    if len(y) < 20 or not np.ptp(y) > 1e-9 or not np.ptp(x) > 1.0:
        return None
    slope = float(x @ y / (x @ x))
    left = y - slope * x
    neighbours = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300)
    correlation = min(max(neighbours, 0.0), 0.99)
    inflation = (1.0 + correlation) / (1.0 - correlation)
    std = float(np.sqrt(left.var() * inflation / (x @ x)))
    evidence = (slope / std) ** 2 - float(np.log(len(y))) if std > 0.0 else np.inf
    return ClockFinding(
        slope,
        std,
        float(evidence),
        float(np.sqrt((y**2).mean())),
        float(np.sqrt((left**2).mean())),
    )
