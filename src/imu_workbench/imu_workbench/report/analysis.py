# SPDX-License-Identifier: Apache-2.0
"""Analysis of all recordings of a report: models, comparisons, attitudes, diagnoses, pooling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, columns_hash
from imu_recording.user_error import UserError
from numpy.typing import NDArray
from thermal_comp.comparison.compare import Comparison, compare_prepared
from thermal_comp.data.conditions import SENSORS
from thermal_comp.data.motion import resting
from thermal_comp.data.parts_at_rest import parts_at_rest
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.diagnose import Settings, diagnose_inputs
from thermal_comp.diagnosis.grown_model import Growth
from thermal_comp.diagnosis.growth import add_effect
from thermal_comp.diagnosis.inputs import prepare_inputs
from thermal_comp.diagnosis.model_form import with_model_form
from thermal_comp.diagnosis.noise_level import NoiseReference
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.pooling import PoolingTest, examine_prepared
from thermal_comp.model.values import ModelError, ThermalModel

from imu_recording import ImuRecording
from imu_workbench.answer import show_progress
from imu_workbench.parallel import Task, run_tasks
from imu_workbench.report.attitude import AttitudeTask, FilterAttitude, after_startup, is_slow
from imu_workbench.report.modelled import RunErrors, errors_of_run
from imu_workbench.report.slopes import block_slopes

UNNAMED_DEVICE = 'device'
"""Name of a device whose recordings name none."""


@dataclass(frozen=True, eq=False)
class RunAnalysis:
    """One recording, or its part before or after a turn, and what follows from it."""

    name: str
    device: str
    recording: ImuRecording
    kept: NDArray[np.bool_]
    """(n,) rows after the start-up transient."""
    hash: str
    errors: RunErrors | None
    """Under the device's model; None where there is none."""
    attitudes: tuple[FilterAttitude, ...]
    interpolated: bool
    """Whether the filters saw interpolated samples."""


@dataclass(frozen=True, eq=False)
class DeviceAnalysis:
    """The model of one device and how well it holds."""

    name: str
    model: ThermalModel | None
    comparison: Comparison | None
    versions: tuple[Comparison, ...] = ()
    """Comparisons of the earlier versions in the model's history, oldest first."""
    problem: str = ''
    """Why there is no model."""
    note: str = ''
    """Remark on its recordings, or why there is no diagnosis."""


@dataclass(frozen=True, eq=False)
class Certified:
    """The model a certificate is about: the given one, or a line and what the diagnosis names."""

    model: ThermalModel
    comparison: Comparison
    runs: tuple[PreparedRun, ...]
    added: tuple[str, ...] = ()
    """Effects the diagnosis named, which no given model had."""


@dataclass(frozen=True, eq=False)
class Analysis:
    """Results over all recordings."""

    runs: tuple[RunAnalysis, ...]
    devices: tuple[DeviceAnalysis, ...]
    pooling: Mapping[str, PoolingTest]
    """One model for all devices beside one for each, per sensor; empty for a single device."""
    slopes: Mapping[str, Mapping[str, Mapping[str, FloatArray]]]
    """(cycles, 3) per device, sensor and orientation [SI unit/K]."""
    diagnoses: Mapping[str, Mapping[str, Any]]
    """Diagnosis of each device as plain values, with the steps that would follow."""
    left_out: tuple[str, ...] = ()
    """Sentences about the recordings that are left out, as the device moves in them."""
    certified: Mapping[str, Certified] = field(default_factory=dict)
    """Model that the certificate of each device states."""


def analyse_recordings(
    recordings: Sequence[ImuRecording],
    models: Mapping[str, ThermalModel] | None = None,
    *,
    attitudes: bool = True,
    diagnosis: bool = True,
    catalogue: Mapping[str, type[Effect]] = EFFECTS,
    reference: NoiseReference | None = None,
    workers: int = 1,
) -> Analysis:
    """Return the analysis of the recordings; a device without a given model is fitted a line.

    Recordings of a moving device are left out; MovingError where nothing else is there.
    `attitudes` False leaves the orientation filters out, `diagnosis` False the search for missing
    effects of the catalogue; `reference` is the noise that counts as normal, None that of the
    shipped chip; `workers` processes share the work.
    """
    unnamed = unnamed_note(recordings)
    recordings, left_out = resting(named(recordings))
    given = models or {}
    devices, prepared = fit_devices(recordings, given, unnamed)
    lines = {d.name: d.model for d in devices.values() if d.model and d.name not in given}
    filtering = attitude_tasks(recordings, devices) if attitudes else []
    judged = devices if diagnosis else {}
    diagnosing = diagnosis_tasks(recordings, judged, catalogue, reference, prepared)
    *results, pooling = run_tasks([*filtering, *diagnosing, PoolingTask(prepared, lines)], workers)
    show_progress('')
    angles = results[: len(filtering)] or [()] * len(recordings)
    diagnosed = results[len(filtering) :]
    certified = certified_models(devices, prepared, diagnosed, given)
    diagnoses = [found for found, _ in diagnosed]
    by_name = {run.name: run for run in prepared}
    runs: list[RunAnalysis] = []
    for recording, found in zip(recordings, angles, strict=True):
        model = devices[recording.device].model
        first, *later = parts_at_rest(recording).recordings
        runs.append(analyse_run(first, model, by_name.get(first.run), found))
        runs += [analyse_run(part, model, by_name.get(part.run), ()) for part in later]
    return Analysis(
        runs=tuple(runs),
        devices=tuple(with_problems(devices, diagnoses)),
        pooling=pooling,
        slopes=slopes_of(runs),
        diagnoses={d['device']: d for d in diagnoses if 'problem' not in d},
        left_out=tuple(left_out),
        certified=certified,
    )


def certified_models(
    devices: Mapping[str, DeviceAnalysis],
    prepared: Sequence[PreparedRun],
    diagnoses: Sequence[tuple[Mapping[str, Any], Growth | None]],
    given: Mapping[str, ThermalModel],
) -> dict[str, Certified]:
    """Return the certified model of every device: the given one, else a line and what is named."""
    grown = {found['device']: growth for found, growth in diagnoses if growth}
    result: dict[str, Certified] = {}
    for device in devices.values():
        if device.model is None or device.comparison is None:
            continue
        runs = tuple(run for run in prepared if run.device == device.name)
        growth = None if device.name in given else grown.get(device.name)
        if growth is None:
            result[device.name] = Certified(device.model, device.comparison, runs)
        else:
            added = tuple(f'{s.added} ({"+".join(s.sensors)})' for s in growth.steps)
            result[device.name] = Certified(growth.model, growth.after, runs, added)
    return result


def fit_devices(
    recordings: Sequence[ImuRecording], models: Mapping[str, ThermalModel], unnamed: str
) -> tuple[dict[str, DeviceAnalysis], list[PreparedRun]]:
    """Return every device under its model, and the prepared runs of all of them.

    `unnamed` is the note of the device that stands for recordings without a device name.
    """
    devices: dict[str, DeviceAnalysis] = {}
    prepared: list[PreparedRun] = []
    for name in dict.fromkeys(recording.device for recording in recordings):
        show_progress(f'fitting {name} …')
        own = [recording for recording in recordings if recording.device == name]
        device, runs = analyse_device(name, own, models.get(name))
        devices[name] = replace(device, note=unnamed) if name == UNNAMED_DEVICE else device
        prepared += runs
    return devices, prepared


def attitude_tasks(
    recordings: Sequence[ImuRecording], devices: Mapping[str, DeviceAnalysis]
) -> list[Task]:
    """Return a task per recording: run it through the orientation filters."""
    return [AttitudeTask(r, devices[r.device].model, len(recordings)) for r in recordings]


def diagnosis_tasks(
    recordings: Sequence[ImuRecording],
    devices: Mapping[str, DeviceAnalysis],
    catalogue: Mapping[str, type[Effect]],
    reference: NoiseReference | None = None,
    prepared: Sequence[PreparedRun] = (),
) -> list[Task]:
    """Return a task per device that has a model: search it for missing effects."""
    return [
        DiagnosisTask(
            device=device.name,
            recordings=[r for r in recordings if r.device == device.name],
            model=device.model,
            catalogue=catalogue,
            reference=reference,
            prepared=[run for run in prepared if run.device == device.name],
        )
        for device in devices.values()
        if device.model
    ]


def with_problems(
    devices: Mapping[str, DeviceAnalysis], diagnoses: Sequence[Mapping[str, Any]]
) -> list[DeviceAnalysis]:
    """Return the devices, with a note where the diagnosis says why there is none."""
    problems = {found['device']: found['problem'] for found in diagnoses if 'problem' in found}
    return [
        replace(device, note='; '.join(filter(None, (device.note, problems.get(device.name)))))
        for device in devices.values()
    ]


def named(recordings: Sequence[ImuRecording]) -> list[ImuRecording]:
    """Return the recordings with a run name each, unique, and a device name."""
    seen: dict[str, int] = {}
    result = []
    for recording in recordings:
        name = recording.run or recording.source.rstrip('/').rpartition('/')[2] or 'run'
        seen[name] = seen.get(name, 0) + 1
        unique = name if seen[name] == 1 else f'{name} ({seen[name]})'
        device = recording.device or recording.namespace.strip('/') or UNNAMED_DEVICE
        result.append(replace(recording, run=unique, device=device))
    return result


def unnamed_note(recordings: Sequence[ImuRecording]) -> str:
    """Return a note where several bags name no device: they are taken as one."""
    unnamed = [r.source or r.run for r in recordings if not r.device and not r.namespace]
    if len(unnamed) < 2:
        return ''
    return (
        f'{len(unnamed)} bags name no device and are taken as one, {UNNAMED_DEVICE!r}: right for '
        'one device in several runs, wrong for several; then report them one at a time'
    )


def analyse_device(
    name: str, recordings: Sequence[ImuRecording], model: ThermalModel | None
) -> tuple[DeviceAnalysis, list[PreparedRun]]:
    """Return model and comparison of one device, or the `problem` why there is none."""
    try:
        runs = prepare(recordings)
        model = model or fit_prepared([BiasTemperature()], runs)
        older = tuple(compare_prepared(version, runs) for version in model.history)
        return DeviceAnalysis(name, model, compare_prepared(model, runs), older), runs
    except UserError as error:
        if not isinstance(error, ModelError) and model is not None:
            raise
        return DeviceAnalysis(name, None, None, problem=str(error)), []


def analyse_run(
    recording: ImuRecording,
    model: ThermalModel | None,
    prepared: PreparedRun | None,
    attitudes: tuple[FilterAttitude, ...],
) -> RunAnalysis:
    """Return what follows from one recording, or part of one, under a model.

    Rows at the ends in which nothing was measured are left out: of a part, all before and after.
    """
    tracks = np.concatenate([getattr(recording, f) for f in SENSOR_FIELDS.values()], axis=1)
    measured = np.flatnonzero(np.isfinite(tracks).any(axis=1))
    shown = recording.rows(slice(measured[0], measured[-1] + 1)) if len(measured) else recording
    return RunAnalysis(
        name=recording.run,
        device=recording.device,
        recording=shown,
        kept=after_startup(shown),
        hash=prepared.hash if prepared else columns_hash(recording),
        errors=errors_of_run(prepared, model) if prepared and model else None,
        attitudes=attitudes,
        interpolated=is_slow(shown),
    )


def slopes_of(runs: Sequence[RunAnalysis]) -> dict[str, dict[str, dict[str, FloatArray]]]:
    """Return the slopes of every cycle, by device, sensor and orientation."""
    found: dict[str, dict[str, dict[str, list[FloatArray]]]] = {}
    for run in runs:
        for sensor, name in SENSOR_FIELDS.items():
            slopes = block_slopes(run.recording, getattr(run.recording, name), run.kept)
            if len(slopes):
                place = found.setdefault(run.device, {}).setdefault(sensor, {})
                place.setdefault(run.recording.up_axis or run.name, []).append(slopes)
    return {
        device: {
            sensor: {up: np.concatenate(parts) for up, parts in by_orientation.items()}
            for sensor, by_orientation in sensors.items()
        }
        for device, sensors in found.items()
    }


@dataclass(frozen=True, eq=False)
class DiagnosisTask:
    """The recordings of one device and the model to be diagnosed."""

    device: str
    recordings: Sequence[ImuRecording]
    model: ThermalModel
    catalogue: Mapping[str, type[Effect]] = field(default_factory=lambda: EFFECTS)
    reference: NoiseReference | None = None
    """Noise that counts as normal; None: that of the shipped chip."""
    prepared: Sequence[PreparedRun] = ()
    """The runs of the recordings, where they are prepared already."""

    @property
    def label(self) -> str:
        """What is diagnosed."""
        return f'diagnosing {self.device}'

    @property
    def size(self) -> float:
        """As long as filtering so many rows [10⁶]."""
        return 3.0 + 1.5e-6 * sum(map(len, self.recordings))

    def run(self) -> tuple[dict[str, Any], Growth | None]:
        """Return the diagnosis as plain values, with `steps`, and the model with what it names.

        Where the recordings cannot be diagnosed, `problem` says why and nothing else is there.
        """
        try:
            inputs = prepare_inputs(self.recordings, prepared=self.prepared)
            found = diagnose_inputs(inputs, self.model, self.catalogue, self.reference)
            content = found.to_dict()
        except ModelError as error:
            return {'device': self.device, 'problem': f'not diagnosed: {error}'}, None
        growth = self._with_named(inputs.runs, content['findings'])
        steps = [step.to_dict() for step in growth.steps] if growth else []
        return content | {'steps': steps}, growth

    def _with_named(
        self, runs: Sequence[PreparedRun], findings: Sequence[Mapping[str, Any]]
    ) -> Growth | None:
        """Return the model with every effect that was named, all of one diagnosis."""
        named = [finding for finding in findings if finding['kind'] == 'effect']
        if not named:
            return None
        settings = Settings(self.catalogue)
        model, growths = self.model, []
        for finding in named:
            sensors = [s for s in SENSORS if s in finding['sensor'].split('+')]
            growths.append(
                add_effect(model, runs, finding['name'], settings, sensors, judged=False)
            )
            model = growths[-1].model
        steps = tuple(
            replace(step, ambiguous_with=tuple(finding['ambiguous_with']))
            for finding, growth in zip(named, growths, strict=True)
            for step in growth.steps
        )
        certified = with_model_form(growths[-1].model, runs)
        return replace(growths[-1], model=certified, before=growths[0].before, steps=steps)


@dataclass(frozen=True, eq=False)
class PoolingTask:
    """The runs of several devices and their linear models, where these are fitted already."""

    runs: Sequence[PreparedRun]
    models: Mapping[str, ThermalModel]

    @property
    def label(self) -> str:
        """What is fitted."""
        return 'fitting all devices together'

    @property
    def size(self) -> float:
        """About as long as a filter run over two hours."""
        return 0.5

    def run(self) -> Mapping[str, PoolingTest]:
        """Return the test per sensor; none for one device, or where it cannot be fitted."""
        if len({run.device for run in self.runs}) < 2:
            return {}
        try:
            return examine_prepared(self.runs, self.models)[1]
        except ModelError:
            return {}
