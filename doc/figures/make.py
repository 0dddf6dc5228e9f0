# SPDX-License-Identifier: Apache-2.0
"""Make the pictures of README.md and doc/walkthrough.md from the bags that ship.

Usage: python doc/figures/make.py
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from imu_recording.recording import PHASES, SENSOR_FIELDS
from imu_workbench.report.figures.modelled import LARGEST_SHOWN_RATIO
from imu_workbench.report.figures.palette import COLOURS
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.image import AxesImage
from thermal_comp.compensation.recording import compensate
from thermal_comp.data.preparation import prepare, prepare_run
from thermal_comp.diagnosis.diagnose import Settings
from thermal_comp.diagnosis.growth import Growth, grow
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from thermal_comp.model.values import ThermalModel

from imu_recording import ImuRecording, read_bag

mpl.use('Agg')
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
BAGS = [HERE.parents[1] / 'bags' / f'hidden_effect_{axis}' for axis in 'xyz']
BLUE, ORANGE, GREY = '#0072b2', '#d55e00', '#9a9a9a'
SHOWN = {'gyroscope': ('m°/s', 1e3 * 180 / np.pi), 'accelerometer': ('mm/s²', 1e3)}


def shown(sensor: str) -> tuple[str, float]:
    """Unit of the pictures and the factor from SI."""
    return SHOWN.get(sensor, ('µT', 1e6))


def residual(recording: ImuRecording, model: ThermalModel, sensor: str) -> dict[str, np.ndarray]:
    """20 s means of measured − model about the run's mean, in the unit of the pictures."""
    run = prepare_run(compensate(recording, model), 'run')
    values = run.measured[sensor] * shown(sensor)[1]  # type: ignore[index]
    return {
        'time': run.time / 3600.0,
        'temperature': run.temperature,
        'rate': np.gradient(run.temperature, run.time) * 60.0,
        'phase': run.phase,
        'cycle': run.cycle,
        'value': values - np.nanmean(values, axis=0),
    }


def worst_axis(growth: Growth, sensor: str) -> int:
    """Axis on which the linear model fails most."""
    return int(np.argmax(growth.before.sensors[sensor].held_out_rms))  # type: ignore[index]


def draw_time(axes: Axes, before: dict[str, np.ndarray], axis: int, unit: str) -> None:
    """Residual of the linear model over time, with the die temperature."""
    axes.plot(before['time'], before['value'][:, axis], color=ORANGE, lw=0.8)
    axes.set(xlabel='time [h]', ylabel=f'residual [{unit}]', title='1  Where the line fails')
    right = axes.twinx()
    right.plot(before['time'], before['temperature'], color=GREY, lw=0.8)
    right.set_ylabel('die [°C]', color=GREY)


def draw_loop(axes: Axes, before: dict[str, np.ndarray], axis: int, unit: str) -> None:
    """Residual of the linear model over temperature, by branch."""
    rate = before['rate']
    branches = (('heating', rate > 0.5, ORANGE), ('cooling', rate < -0.5, BLUE))
    still = np.abs(rate) <= 0.5
    axes.scatter(before['temperature'][still], before['value'][still, axis], s=3, color=GREY)
    for label, rows, colour in branches:
        values = before['value'][rows, axis]
        axes.scatter(before['temperature'][rows], values, s=3, color=colour, label=label)
    axes.set(xlabel='die temperature [°C]', title='2  A loop: memory is missing')
    axes.set_ylabel(f'residual [{unit}]')
    axes.legend(frameon=False, markerscale=3, loc=(0.1, 0.5))


def draw_error_steps(axes: Axes, growth: Growth, sensor: str, measured: float) -> None:
    """Held-out error with every term added."""
    unit, factor = shown(sensor)
    steps = [s for s in growth.steps if sensor in s.sensors]
    names = ['no model', 'bias_temperature', *[f'+ {s.added}' for s in steps]]
    heights = [measured, steps[0].error_before, *[s.error_after for s in steps]]
    heights = [height * factor for height in heights]
    bars = axes.bar(names, heights, color=[GREY, ORANGE, *[BLUE] * len(steps)], width=0.6)
    axes.bar_label(bars, [f'{height:.3g}' for height in heights], padding=2)
    floor = steps[-1].noise_floor * factor
    axes.axhline(floor, color='black', lw=1, ls='--', label=f'noise floor {floor:.2g}')
    axes.legend(frameon=False, loc='upper right')
    axes.set_yscale('log')
    axes.set_ylim(floor * 0.6, heights[0] * 2.2)
    axes.set(ylabel=f'held-out rms [{unit}]', title='3  Added: the error falls')


def draw_map(axes: Axes, found: dict[str, np.ndarray], axis: int, floor: float) -> AxesImage:
    """Residual over noise floor per phase and cycle, on the scale of the report's maps."""
    table = np.full((len(PHASES), 5), np.nan)
    for phase in range(len(PHASES)):
        for cycle in range(5):
            rows = (found['phase'] == phase) & (found['cycle'] == cycle)
            if rows.any():
                table[phase, cycle] = np.sqrt(np.nanmean(found['value'][rows, axis] ** 2)) / floor
    light = COLOURS['light']
    places = ((0.0, 'calm'), (0.11, 'calm'), (0.5, 'raised'), (1.0, 'loud'))
    colours = LinearSegmentedColormap.from_list('floor', [(x, light[c]) for x, c in places])
    image = axes.imshow(
        table.clip(1.0, LARGEST_SHOWN_RATIO),
        cmap=colours,
        norm=LogNorm(1.0, LARGEST_SHOWN_RATIO),
        aspect='auto',
    )
    for (phase, cycle), value in np.ndenumerate(table):
        if np.isfinite(value):
            colour = 'white' if value > 0.6 * LARGEST_SHOWN_RATIO else 'black'
            axes.text(cycle, phase, f'{value:.2g} ×', ha='center', va='center', color=colour)
    axes.set_yticks(range(len(PHASES)), [name.replace('_', ' ') for name in PHASES])
    axes.set_xticks(range(5), ['outside', 'R1', 'R2', 'R3', 'R4'])
    return image


def draw_after(
    axes: Axes, before: dict[str, np.ndarray], after: dict[str, np.ndarray], axis: int, unit: str
) -> None:
    """Residual over time without and with the effect."""
    axes.plot(before['time'], before['value'][:, axis], color=ORANGE, lw=0.8, label='line')
    axes.plot(after['time'], after['value'][:, axis], color=BLUE, lw=0.8, label='line and effect')
    axes.set(xlabel='time [h]', ylabel=f'residual [{unit}]')
    axes.legend(frameon=False, loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2)


def save(figure: plt.Figure, name: str) -> None:
    """Write a picture beside this file."""
    figure.savefig(HERE / name, dpi=110, metadata={'Software': None})
    plt.close(figure)


def main(bags: Sequence[Path] = BAGS) -> None:
    """Write overview.png, where.png and after.png beside this file."""
    plt.rcParams.update({'font.size': 10, 'axes.spines.top': False, 'axes.grid': False})
    recordings = [read_bag(path) for path in bags]
    line = fit((EFFECTS['bias_temperature'](),), recordings)
    growth = grow(None, prepare(recordings), Settings(dict(EFFECTS)))
    sensor = growth.steps[0].sensors[0]
    unit, _ = shown(sensor)
    axis = worst_axis(growth, sensor)
    before = residual(recordings[0], line, sensor)
    after = residual(recordings[0], growth.model, sensor)
    measured = float(np.sqrt(np.mean(np.square(growth.before.sensors[sensor].measured_rms))))
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.6), layout='constrained')
    draw_time(axes[0], before, axis, unit)
    draw_loop(axes[1], before, axis, unit)
    draw_error_steps(axes[2], growth, sensor, measured)
    figure.suptitle(f'{growth.model.device} {sensor} {"xyz"[axis]}, {SENSOR_FIELDS[sensor]}')
    save(figure, 'overview.png')
    floor = float(growth.after.sensors[sensor].noise_floor[axis]) * shown(sensor)[1]
    figure, axes = plt.subplots(1, 2, figsize=(12, 4), layout='constrained')
    titles = ('line per axis', f'with {growth.steps[0].added}')
    for place, title, found in zip(axes, titles, (before, after), strict=True):
        image = draw_map(place, found, axis, floor)
        place.set_title(title)
    bar = figure.colorbar(image, ax=axes, label='residual, times the noise floor')
    bar.set_ticks([1.0, 2.0, 5.0, LARGEST_SHOWN_RATIO], labels=['1', '2', '5', '≥ 10'])
    bar.minorticks_off()
    save(figure, 'where.png')
    figure, axes_after = plt.subplots(figsize=(9, 3), layout='constrained')
    draw_after(axes_after, before, after, axis, unit)
    save(figure, 'after.png')


if __name__ == '__main__':
    main()
