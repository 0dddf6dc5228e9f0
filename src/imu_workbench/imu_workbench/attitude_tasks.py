# SPDX-License-Identifier: Apache-2.0
"""The orientation filters over many recordings, several at a time where cores are free."""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from orientation_filters.filters import sample_rate
from orientation_filters.upsample import upsample
from thermal_comp.compensator import compensate
from thermal_comp.model import ThermalModel
from thermal_comp.startup import startup_rows

from imu_recording import ImuRecording
from imu_workbench.attitude import DATA, Attitude, estimate_attitudes
from imu_workbench.progress import show_progress

FILTER_RATE = 50.0
"""Slowest rate [Hz] the filters are run at; slower recordings are interpolated to it."""
ALL_POINTS = 4_000
"""Points per line of all recordings together."""


@dataclass(frozen=True, eq=False)
class AttitudeTask:
    """One recording to be run through the filters, raw and compensated."""

    recording: ImuRecording
    model: ThermalModel | None
    among: int
    """Number of recordings whose lines share a page."""

    def run(self) -> tuple[Attitude, ...]:
        """Return the attitudes; none without a model."""
        kept = settled(self.recording)
        if self.model is None or kept.sum() < 2:
            return ()
        raw = self.recording.rows(kept)
        compensated = compensate(raw, self.model)
        slow = is_slow(raw)
        if slow:
            raw, compensated = upsample(raw, FILTER_RATE), upsample(compensated, FILTER_RATE)
        found = estimate_attitudes(
            raw,
            compensated,
            data=(DATA[0], DATA[-1]) if slow else DATA,
            every=round(FILTER_RATE) if slow else 1,
            points=int(np.clip(ALL_POINTS / self.among, 250, 1000)),
        )
        return tuple(found)


def is_slow(recording: ImuRecording) -> bool:
    """Tell whether the recording has to be interpolated for the filters."""
    return not sample_rate(recording) >= 0.98 * FILTER_RATE


def settled(recording: ImuRecording) -> NDArray[np.bool_]:
    """Return (n,) the rows after the start-up transient."""
    kept = np.ones(len(recording), dtype=bool)
    kept[: startup_rows(recording)[0]] = False
    return kept


def study_attitudes(tasks: Sequence[AttitudeTask], workers: int) -> list[tuple[Attitude, ...]]:
    """Return the attitudes of each task, in order; `workers` forked processes share the work."""
    if workers < 2 or len(tasks) < 2:
        found = []
        for task in tasks:
            show_progress(f'filtering {task.recording.run} …')
            found.append(task.run())
        return found
    _WAITING[:] = tasks  # forked processes see the recordings without copying them
    longest_first = sorted(range(len(tasks)), key=lambda i: -len(tasks[i].recording))
    done: dict[int, tuple[Attitude, ...]] = {}
    try:
        context = multiprocessing.get_context('fork')
        with ProcessPoolExecutor(min(workers, len(tasks)), mp_context=context) as pool:
            for i, attitudes in zip(longest_first, pool.map(_run, longest_first), strict=True):
                done[i] = attitudes
                show_progress(f'filtering: {len(done)} of {len(tasks)} runs …')
    finally:
        _WAITING.clear()
    return [done[i] for i in range(len(tasks))]


_WAITING: list[AttitudeTask] = []


def _run(index: int) -> tuple[Attitude, ...]:
    return _WAITING[index].run()
