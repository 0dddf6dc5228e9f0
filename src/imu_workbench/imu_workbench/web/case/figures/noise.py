# SPDX-License-Identifier: Apache-2.0
"""Spectrum and Allan deviation of the residual beside those of its noise model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.model.values import NoiseModel
from thermal_comp.presentation.display import DISPLAY_UNITS

from imu_workbench.report.figures.measured import curve
from imu_workbench.report.figures.panels import Figure, Panel, figure, trace_axes
from imu_workbench.web.case.figures.run_blocks import RunBlocks
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import View, inside_window

MIN_OCTAVES = 4
"""Octaves a line needs at least."""
MAX_ALLAN_SAMPLES = 2**20
"""Samples used at most, from the beginning of a bag, for averaging times below a block."""


def spectrum_figure(version: Version, view: View) -> Figure:
    """Return the amplitude density of the residual's block means, averaged in bands."""
    unit, factor = DISPLAY_UNITS[view.sensor].unit, DISPLAY_UNITS[view.sensor].factor
    frequency, density = residual_spectrum(blocks_in_window(version, view), view)
    data: list[dict[str, Any]] = [
        curve({'x': rounded_log(frequency), 'y': rounded_log(np.sqrt(density) * factor)},
              'residual', trace_axes(0), color=f'@{view.axis_name}', width=1.8,
              hovertemplate=f'%{{y:.3~g}} {unit}/√Hz at %{{x:.3~g}} Hz<extra></extra>'),
    ]  # fmt: skip
    noise = version.noise.get(view.sensor)
    if noise is not None and len(frequency):
        expected = np.sqrt(noise_density(noise, view.axis, frequency, version.blocks[0].period))
        data.append(
            curve({'x': rounded_log(frequency), 'y': rounded_log(expected * factor)},
                  'noise model', trace_axes(0), color='@model', width=1.8, dash='dash')
        )  # fmt: skip
    x, y = ([v for trace in data for v in trace[axis] if v] for axis in 'xy')
    panel = Panel(
        'frequency [Hz]', f'residual [{unit}/√Hz]', x=logarithmic(x), y=logarithmic(y)
    )  # fmt: skip
    return _finished(data, panel)


def allan_figure(version: Version, view: View, bags: Sequence[StoredBag]) -> Figure:
    """Return the Allan deviation: of samples below 20 s, of the residual above."""
    unit, factor = DISPLAY_UNITS[view.sensor].unit, DISPLAY_UNITS[view.sensor].factor
    short = [_allan_of_samples(bag, view, version.blocks[0].period) for bag in bags]
    long = [
        allan_variance(run.residual(view.sensor)[:, view.axis], run.period)
        for run in blocks_in_window(version, view)
    ]
    series = (('samples', short, '@raw'), ('residual', long, f'@{view.axis_name}'))
    data: list[dict[str, Any]] = []
    reach: list[float] = []
    for name, parts, colour in series:
        tau, variance = _pooled(parts)
        if len(tau) < MIN_OCTAVES:
            continue
        reach += tau.tolist()
        data.append(
            curve({'x': rounded_log(tau), 'y': rounded_log(np.sqrt(variance) * factor)}, name,
                  trace_axes(0), color=colour, width=1.8,
                  hovertemplate=f'{name}: %{{y:.3~g}} {unit} at %{{x:.3~g}} s<extra></extra>')
        )  # fmt: skip
    noise = version.noise.get(view.sensor)
    if noise is not None and reach:
        tau = np.geomspace(min(reach), max(reach), 40)
        expected = np.sqrt(noise_allan_variance(noise, view.axis, tau)) * factor
        data.append(
            curve({'x': rounded_log(tau), 'y': rounded_log(expected)}, 'noise model',
                  trace_axes(0), color='@model', width=1.8, dash='dash')
        )  # fmt: skip
    drawn = [y for trace in data for y in trace['y'] if y]
    panel = Panel(
        'averaging time [s]', f'Allan deviation [{unit}]', x=logarithmic(reach),
        y=logarithmic(drawn) | {'range': decades(drawn)},
    )  # fmt: skip
    return _finished(data, panel)


def blocks_in_window(version: Version, view: View) -> list[RunBlocks]:
    """Return the blocks of every run that lie in the view's window."""
    inside = inside_window(version.blocks, version.timeline, view.window)
    edges = np.cumsum([0, *(len(run.time) for run in version.blocks)])
    parts = zip(version.blocks, edges[:-1], edges[1:], strict=True)
    cut = [run.at(inside[first:last]) for run, first, last in parts]
    return [run for run in cut if len(run.time)]


def logarithmic(values: Sequence[float]) -> dict[str, Any]:
    """Return an axis of positive values, labelled at decades; at 2 and 5 where these are few."""
    few = max(values, default=1.0) / min(values, default=1.0) < 1e3
    return {'type': 'log', 'dtick': 'D2' if few else 1, 'minor': {'ticks': 'outside'}}


def residual_spectrum(blocks: Sequence[RunBlocks], view: View) -> tuple[FloatArray, FloatArray]:
    """Return frequency [Hz] and one-sided power density [unit²/Hz], a tenth of a decade each.

    Holes count as zero; the power is referred to the blocks there are.
    """
    frequencies, densities = [], []
    for run in blocks:
        values = run.residual(view.sensor)[:, view.axis]
        good = np.isfinite(values)
        if good.sum() < 16:
            continue
        slot = np.round((run.time - run.time[0]) / run.period).astype(np.int64)
        grid = np.zeros(int(slot[-1]) + 1)
        grid[slot[good]] = values[good] - values[good].mean()
        power = 2.0 * run.period * np.abs(np.fft.rfft(grid)) ** 2 / good.sum()
        frequencies.append(np.fft.rfftfreq(len(grid), run.period)[1:])
        densities.append(power[1:])
    if not frequencies:
        return np.empty(0), np.empty(0)
    frequency, density = np.concatenate(frequencies), np.concatenate(densities)
    band = np.floor(10.0 * np.log10(frequency)).astype(np.int64)
    numbers, member = np.unique(band, return_inverse=True)
    count = np.bincount(member)
    mean = np.bincount(member, density) / count
    centre = np.exp(np.bincount(member, np.log(frequency)) / count)
    return centre[: len(numbers)], mean


def noise_density(
    noise: NoiseModel, axis: int, frequency: FloatArray, period: float
) -> FloatArray:
    """Return the one-sided power density of means over `period` [unit²/Hz].

    2 σ²_white + Σ 4 σ_k² τ_k / (1 + (2πf τ_k)²), times sinc²(f T).
    """
    turns = 2.0 * np.pi * frequency[:, None] * noise.time_constants
    coloured = 4.0 * noise.amplitudes[:, axis] ** 2 * noise.time_constants / (1.0 + turns**2)
    density: FloatArray = (
        2.0 * noise.white[axis] ** 2 + coloured.sum(axis=1) * np.sinc(frequency * period) ** 2
    )
    return density


def noise_allan_variance(noise: NoiseModel, axis: int, tau: FloatArray) -> FloatArray:
    """Return σ²_white / τ + Σ 2 σ_k² r (1 − r/2 (3 − 4 e^{−1/r} + e^{−2/r})), r = τ_k / τ.

    IEEE Std 952, annex C (exponentially correlated noise).
    """
    r = noise.time_constants / tau[:, None]
    decay = np.exp(-1.0 / r)
    bracket = 1.0 - 0.5 * r * (3.0 - 4.0 * decay + decay**2)
    coloured = 2.0 * noise.amplitudes[:, axis] ** 2 * r * np.maximum(bracket, 0.0)
    variance: FloatArray = noise.white[axis] ** 2 / tau + coloured.sum(axis=1)
    return variance


def allan_variance(values: FloatArray, period: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return averaging time [s], Allan variance [unit²] and number of differences, by octaves.

    Means over 2^k samples, neighbours subtracted; pairs with a hole are left out.
    """
    taus, variances, counts = [], [], []
    means = np.asarray(values, dtype=np.float64)
    tau = period
    while len(means) >= 4:
        steps = np.diff(means)
        steps = steps[np.isfinite(steps)]
        if len(steps) >= 3:
            taus.append(tau)
            variances.append(0.5 * float((steps**2).mean()))
            counts.append(float(len(steps)))
        even = means[: len(means) // 2 * 2]
        means = 0.5 * (even[::2] + even[1::2])
        tau *= 2.0
    return np.array(taus), np.array(variances), np.array(counts)


def _allan_of_samples(
    bag: StoredBag, view: View, longest: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    period = bag.duration / max(bag.samples - 1, 1)
    values = bag.measured(view.sensor)[:MAX_ALLAN_SAMPLES, view.axis]
    tau, variance, count = allan_variance(values, period)
    kept = tau <= max(longest, period)
    return tau[kept], variance[kept], count[kept]


def _pooled(
    parts: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
) -> tuple[FloatArray, FloatArray]:
    """Return the mean over the runs, octave by octave."""
    octaves: dict[int, list[tuple[float, float, float]]] = {}
    for tau, variance, count in parts:
        for t, v, n in zip(tau, variance, count, strict=True):
            octaves.setdefault(round(np.log2(t)), []).append((t, v, n))
    taus, variances = [], []
    for number in sorted(octaves):
        rows = np.array(octaves[number])
        taus.append(rows[:, 0].mean())
        variances.append(np.average(rows[:, 1], weights=rows[:, 2]))
    return np.array(taus), np.array(variances)


def decades(values: Sequence[float]) -> list[float]:
    """Return the range of a logarithmic axis around the values, a decade at the least.

    >>> [round(end, 2) for end in decades([0.01, 0.02])]
    [-2.18, -1.18]
    """
    low = np.log10(min(values, default=1.0) / 1.5)
    return [float(low), float(max(low + 1.0, np.log10(max(values, default=1.0) * 1.5)))]


def rounded_log(values: FloatArray) -> list[float | None]:
    """Return values with four significant digits; None where not positive."""
    return [float(f'{v:.4g}') if v > 0.0 and np.isfinite(v) else None for v in values.tolist()]


def _finished(data: list[dict[str, Any]], panel: Panel) -> Figure:
    spec = figure(data, [panel], height=230)
    for part in (spec['layout'], spec['narrow']):
        part['margin'] = part['margin'] | {'t': 34}
    return spec
