# SPDX-License-Identifier: Apache-2.0
"""One version of a device's model with everything the pages show of it, as plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from thermal_comp.comparison.compare import Comparison, rms_of
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.model.file import load_model, save_model
from thermal_comp.model.values import NoiseModel, ThermalModel
from thermal_comp.presentation.display import with_uncertainty

from imu_workbench.answer import plain
from imu_workbench.report.model_content import sensor_terms
from imu_workbench.web.case.figures.run_blocks import RunBlocks, blocks_of_runs
from imu_workbench.web.case.view import Timeline


@dataclass(frozen=True, eq=False)
class Version:
    """A model, compared with the runs of its device."""

    label: str
    """What was done to get here."""
    model_text: str
    """The model file."""
    comparison: Mapping[str, Any]
    """What `compare --json` writes."""
    blocks: tuple[RunBlocks, ...]
    effects: Mapping[str, tuple[str, ...]]
    """Names per sensor."""
    noise: Mapping[str, NoiseModel]
    terms: tuple[Mapping[str, Any], ...] = ()
    """Parameters of the effects: sensor, effect, parameter, value, std, unit."""
    coefficients: tuple[Mapping[str, Any], ...] = ()
    """Columns of the effects: sensor, effect, value and uncertainty per axis, unit [SI]."""
    unneeded: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())
    timeline: Timeline | None = None
    """Where each run lies on the common axis; None where nothing is drawn."""

    def error(self, sensor: str) -> float:
        """Held-out rms over the axes [SI unit]."""
        return rms_of(self.comparison['sensors'][sensor]['held_out_rms'])

    def floor(self, sensor: str) -> float:
        """Noise floor of `error` [SI unit]."""
        return rms_of(self.comparison['sensors'][sensor]['noise_floor'])

    def measured(self, sensor: str) -> float:
        """Error without any model, rms over the axes [SI unit]."""
        return rms_of(self.comparison['sensors'][sensor]['measured_rms'])

    def missing(self) -> dict[str, float]:
        """Return the error beyond the noise, of sensors that are above it, rms [SI unit]."""
        beyond = {s: self.error(s) ** 2 - self.floor(s) ** 2 for s in self.comparison['sensors']}
        ordered = sorted(beyond, key=lambda s: -self.error(s) / self.floor(s))
        return {s: math.sqrt(beyond[s]) for s in ordered if beyond[s] > 0.0}

    def errors(self) -> dict[str, dict[str, float]]:
        """Return measured, held-out error and floor of every sensor [SI unit]."""
        return {
            s: {'measured': self.measured(s), 'error': self.error(s), 'floor': self.floor(s)}
            for s in self.comparison['sensors']
        }


def make_version(
    label: str,
    model: ThermalModel,
    comparison: Comparison,
    runs: Sequence[PreparedRun],
    unneeded: Sequence[str] = (),
) -> Version:
    """Return the version of a model."""
    return Version(
        label=label,
        model_text=model_as_text(model),
        comparison=plain(comparison.to_dict()),
        blocks=tuple(blocks_of_runs(model, runs)),
        effects={s: tuple(e.name for e in part.effects) for s, part in model.sensors.items()},
        noise={s: part.noise for s, part in model.sensors.items() if part.noise is not None},
        terms=tuple(_terms(model)),
        coefficients=tuple(
            plain({k: value for k, value in row.items() if k != 'shape'})
            for sensor, part in model.sensors.items()
            for row in sensor_terms(sensor, part)
        ),
        unneeded=tuple(unneeded),
        notes=tuple(dict.fromkeys((*comparison.notes, *model.provenance.notes))),
    )


def model_as_text(model: ThermalModel) -> str:
    """Return the model file's text."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'model.yaml'
        save_model(model, path)
        return path.read_text('utf-8')


def model_from_text(text: str, catalogue: Mapping[str, type[Effect]]) -> ThermalModel:
    """Return the model of a model file's text."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'model.yaml'
        path.write_text(text, 'utf-8')
        return load_model(path, catalogue)


def parameter_text(value: Any, std: Any) -> str:
    """Return value ± standard deviation, or a list of them."""
    if isinstance(value, list):
        spread = std if isinstance(std, list) else [None] * len(value)
        return ', '.join(with_uncertainty(v, s) for v, s in zip(value, spread, strict=True))
    if isinstance(std, list):
        std = std[0] if std else None
    return with_uncertainty(value, std)


def _terms(model: ThermalModel) -> list[dict[str, Any]]:
    rows = []
    for sensor, part in model.sensors.items():
        for effect in part.effects:
            for name, value in effect.shape_parameters.items():
                std = part.shape_std.get(f'{effect.name}.{name}')
                unit = effect.__dataclass_fields__[name].metadata.get('unit', '')
                rows.append({
                    'sensor': sensor, 'effect': effect.name, 'parameter': name,
                    'value': plain(value), 'std': plain(std), 'unit': unit,
                })  # fmt: skip
    return rows
