# SPDX-License-Identifier: Apache-2.0
"""Growth of a model: where it fails, which effect is missing, what adding it brings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imu_recording.recording import FloatArray
from thermal_comp.comparison.compare import rms_of
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.quality import check_quality
from thermal_comp.diagnosis.diagnose import Settings, diagnose_prepared
from thermal_comp.diagnosis.grown_model import Growth
from thermal_comp.diagnosis.growth import MOST_STEPS, add_effect
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ThermalModel
from thermal_comp.presentation.display import DISPLAY_UNITS, shown, with_uncertainty

from imu_recording import read_bag
from imu_workbench.report.attitude import AttitudeTask, is_slow
from imu_workbench.report.error_steps import degree_steps, degrees
from imu_workbench.report.model_content import version_names
from imu_workbench.report.modelled import errors_of_run, failure_map_of

FILTER_NAMES = {'complementary': 'complementary filter', 'ahrs': 'AHRS'}


@dataclass(frozen=True, eq=False)
class ModelGrowthTask:
    """The bags of one device whose model is to grow until nothing is missing."""

    bags: Sequence[Path]
    catalogue: Mapping[str, type[Effect]] = field(default_factory=lambda: EFFECTS)
    """Effects that may be missing."""

    @property
    def label(self) -> str:
        """What is looked for."""
        return f'looking for the effect hidden in {", ".join(bag.name for bag in self.bags)}'

    @property
    def size(self) -> float:
        """As long as filtering so many rows [10⁶]."""
        return 10.0

    def run(self) -> dict[str, Any]:
        """Return the growth as plain values; `lines` are for people."""
        recordings = [read_bag(bag) for bag in self.bags]
        runs = prepare(check_quality(recordings)[0])
        line = fit_prepared([BiasTemperature()], runs)
        grown = list(_growth_steps(line, runs, self.catalogue))
        model = grown[-1][1].model if grown else line
        attitudes = [
            row | {'run': recording.run, 'interpolated': is_slow(recording)}
            for recording in recordings
            for row in degrees(
                AttitudeTask(recording, model, len(recordings)).run(), len(model.history)
            )
        ]
        content = {
            'bags': [str(bag) for bag in self.bags],
            'device': model.device,
            'findings': [finding for finding, _ in grown],
            'steps': [step.to_dict() for _, growth in grown for step in growth.steps],
            'sensors': _sensors(line, [growth for _, growth in grown], runs),
            'versions': ['raw', *version_names(model)],
            'degrees': attitudes,
        }
        return content | {'lines': growth_lines(content)}


def _growth_steps(
    line: ThermalModel, runs: Sequence[PreparedRun], catalogue: Mapping[str, type[Effect]]
) -> Iterator[tuple[dict[str, Any], Growth]]:
    """Yield each missing effect and the model with it, until none is missing."""
    model, settings = line, Settings(catalogue)
    for _ in range(MOST_STEPS):
        findings = diagnose_prepared(runs, model, settings).to_dict()['findings']
        found = next((f for f in findings if f['kind'] == 'effect'), None)
        if found is None:
            return
        sensors = [s for s in SENSORS if s in found['sensor'].split('+')]
        growth = add_effect(model, runs, found['name'], settings, sensors, judged=False)
        yield found, growth
        model = growth.model


def _sensors(
    line: ThermalModel, grown: Sequence[Growth], runs: Sequence[PreparedRun]
) -> dict[str, Any]:
    """Return per sensor that gained an effect: error after each step, maps before and after."""
    steps = [step for growth in grown for step in growth.steps]
    told: dict[str, Any] = {}
    for sensor in (s for s in SENSORS if any(s in step.sensors for step in steps)):
        unit = DISPLAY_UNITS[sensor]
        before = grown[0].before.sensors[sensor]
        floor = grown[-1].after.sensors[sensor].noise_floor
        errors = [('measured', rms_of(before.measured_rms))]
        errors.append(('bias temperature', rms_of(before.held_out_rms)))
        errors += [
            (f'+ {step.added.replace("_", " ")}', step.error_after)
            for step in steps
            if sensor in step.sensors
        ]
        told[sensor] = {
            'unit': unit.unit,
            'steps': [{'label': name, 'error': error * unit.factor} for name, error in errors],
            'proposed': [],
            'floor': rms_of(floor) * unit.factor,
            'maps': {
                'before': _map(line, runs, sensor, floor),
                'after': _map(grown[-1].model, runs, sensor, floor),
            },
        }
    return told


def _map(
    model: ThermalModel, runs: Sequence[PreparedRun], sensor: Sensor, floor: FloatArray
) -> dict[str, Any] | None:
    errors = [errors_of_run(run, model) for run in runs]
    return failure_map_of([(error, error.residual(sensor)) for error in errors], floor)


def growth_lines(content: dict[str, Any]) -> list[str]:
    """Return the growth in at most ten lines."""
    bags = ', '.join(Path(bag).name for bag in content['bags'])
    head = f'A hidden effect, found and removed ({bags}; {content["device"]}):'
    if not content['steps']:
        return [head, '  nothing is missing: the line per axis leaves noise only']
    lines = [head]
    for sensor, part in list(content['sensors'].items())[:2]:
        lines.append(f'  it fails here    {sensor}: {_worst(part["maps"]["before"])}')
    named = '; '.join(_named(finding) for finding in content['findings'][:2])
    lines.append(f'  this is missing  {named}')
    added = ', '.join(f'{step["added"]} ({step["sensor"]})' for step in content['steps'])
    lines.append(f'  added            {added}; everything refitted together')
    for sensor, part in list(content['sensors'].items())[:2]:
        errors = ' → '.join(shown(step['error']) for step in part['steps'])
        lines.append(
            f'  error            {errors} {part["unit"]}: {sensor} measured, with the line, with '
            'the effect (on cycles the fit has not seen)'
        )
    for name, part in degree_steps(content).items():
        errors = '° → '.join(shown(step['error']) for step in part['steps'])
        lines.append(
            f'  in degrees       {errors}°: {FILTER_NAMES.get(name, name)}{_mark(content)}'
        )
    floors = [f'{shown(p["floor"])} {p["unit"]} ({s})' for s, p in content['sensors'].items()]
    left = [f'{p["steps"][-1]["error"] / p["floor"]:.2f}' for p in content['sensors'].values()]
    lines.append(f'  noise floor      {", ".join(floors)}; {", ".join(left)} × that is left')
    return lines


def _worst(where: dict[str, Any] | None) -> str:
    if where is None:
        return 'over the whole run (no phases were logged)'
    cells = [
        (ratio, phase, cycle)
        for phase, row in zip(where['phases'], where['ratio'], strict=True)
        for cycle, ratio in zip(where['cycles'], row, strict=True)
        if ratio is not None
    ]
    ratio, phase, cycle = max(cells)
    return f'{phase.replace("_", " ")}, cycle {cycle}: {ratio:.1f} × the noise floor'


def _named(finding: dict[str, Any]) -> str:
    values = ', '.join(
        f'{name.replace("_", " ")} {_value(found)}'
        for name, found in finding['parameters'].items()
        if isinstance(found['value'], float)
    )
    shape = f', {values}' if values else ''
    return (
        f'{finding["name"]} of the {finding["sensor"]}{shape} (evidence {finding["evidence"]:.0f})'
    )


def _mark(content: dict[str, Any]) -> str:
    slow = any(row['interpolated'] for row in content['degrees'])
    return ' (interpolated: no verdict)' if slow else ''


def _value(found: dict[str, Any]) -> str:
    width = ' (± one standard deviation)' if found['std'] else ''
    return f'{with_uncertainty(found["value"], found["std"])} {found["unit"]}{width}'
