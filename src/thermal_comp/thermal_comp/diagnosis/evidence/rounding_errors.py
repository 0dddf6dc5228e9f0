# SPDX-License-Identifier: Apache-2.0
"""What rounding to counts coarser than the noise does to a sensor that follows the temperature."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.rounding import Rounding
from thermal_comp.diagnosis.evidence.temperature_course import TemperatureCourse
from thermal_comp.linear.candidate_design import CandidateDesign
from thermal_comp.linear.columns import stack_runs
from thermal_comp.linear.gaussian_evidence import CoefficientPrior

HARMONICS = 4
"""Harmonics of what rounding to coarse counts makes of a signal that moves."""
ROUNDS = 15
"""How often the signal is found again beside the waves that follow from it."""


def rounding_errors(design: CandidateDesign) -> list[CoefficientPrior]:
    """Return the error of rounding to counts coarser than the noise, per run; [] for fine ones.

    It is a wave along the signal, whose course the temperature tells; over temperature and time
    each may grow and turn, as that course is known to a part of a count. Only where axes are the
    sensor's own.
    """
    runs = design.source.smoothed
    fine = Rounding(np.zeros(3), np.zeros(3))
    read = [run.rounding.get(design.sensor, fine) for run in runs]
    if not any(r.count.any() for r in read) or not np.array_equal(design.axes, np.eye(3)):
        return []
    course = TemperatureCourse.of(design)
    coefficients = course.coefficients()
    waves: list[FloatArray] = []
    for _ in range(ROUNDS):
        signals = [columns @ coefficients for columns in course.columns]
        waves = [_waves(*pair) for pair in zip(signals, read, strict=True)]
        pairs = zip(runs, waves, design.valid, strict=True)
        means = [run.block_mean(wave)[ok] for run, wave, ok in pairs]
        coefficients = course.coefficients(stack_runs(means, per_run=True))
    wave_of = {run.name: wave for run, wave in zip(runs, waves, strict=True)}

    def slowly_changing(run: PreparedRun) -> FloatArray:
        x = 2.0 * (run.conditions.temperature - course.low) / course.span - 1.0
        slowly = np.stack([np.ones_like(x), x, np.linspace(-1.0, 1.0, len(x))], axis=1)
        wave = wave_of[run.name][:, :, :, None] * slowly[:, None, None, :]
        return run.block_mean(wave.reshape(len(x), 3, -1))

    term = design.generic_terms([(slowly_changing, True)], runs=runs)[0]
    return [CoefficientPrior(term.columns, shared=False, deviation=design.size_of(term))]


def _waves(signal: FloatArray, read: Rounding) -> FloatArray:
    """(n, 3, 2 HARMONICS) sines and cosines along a signal (n, 3), as large as rounding is."""
    fine = read.count == 0.0
    turns = signal / np.where(fine, 1.0, read.count)
    angle = 2.0 * np.pi * np.arange(1, HARMONICS + 1) * turns[:, :, None]
    size = read.wave_sizes(HARMONICS) / np.sqrt(2.0)
    return np.concatenate([size * np.sin(angle), size * np.cos(angle)], axis=2)
