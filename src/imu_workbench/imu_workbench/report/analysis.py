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
from thermal_comp.data.preparation import PreparedRun, prepare
from thermal_comp.data.quality import check_quality
from thermal_comp.diagnosis.diagnose import Settings, diagnose
from thermal_comp.diagnosis.growth import grow
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.pooling import PoolingTest, examine_prepared
from thermal_comp.model.values import ModelError, ThermalModel

from imu_recording import ImuRecording
from imu_workbench.answer import show_progress
from imu_workbench.motion_detection import resting
from imu_workbench.parallel import Task, run_tasks
from imu_workbench.report.attitude import Attitude, AttitudeTask, is_slow, settled
from imu_workbench.report.modelled import RunErrors, errors_of_run
from imu_workbench.report.slopes import block_slopes

UNNAMED = 'device'
"""What a device is called whose recordings name none."""


@dataclass(frozen=True, eq=False)
class StudiedRun:
    """One recording and what follows from it."""

    name: str
    device: str
    recording: ImuRecording
    kept: NDArray[np.bool_]
    """(n,) rows after the start-up transient."""
    hash: str
    errors: RunErrors | None
    """Under the device's model; None where there is none."""
    attitudes: tuple[Attitude, ...]
    interpolated: bool
    """Whether the filters saw interpolated samples."""


@dataclass(frozen=True, eq=False)
class StudiedDevice:
    """The model of one device and how well it holds."""

    name: str
    model: ThermalModel | None
    comparison: Comparison | None
    versions: tuple[Comparison, ...] = ()
    """Of the earlier versions in the model's history, oldest first."""
    problem: str = ''
    """Why there is no model."""
    note: str = ''
    """What a reader has to know of its recordings, and why there is no diagnosis."""


@dataclass(frozen=True, eq=False)
class Study:
    """Results over all recordings."""

    runs: tuple[StudiedRun, ...]
    devices: tuple[StudiedDevice, ...]
    pooling: Mapping[str, PoolingTest]
    """One model for all devices beside one for each, per sensor; empty for a single device."""
    slopes: Mapping[str, Mapping[str, Mapping[str, FloatArray]]]
    """(cycles, 3) per device, sensor and orientation [SI unit/K]."""
    diagnoses: Mapping[str, Mapping[str, Any]]
    """Diagnosis of each device as plain values, with the steps that would follow."""
    left_out: tuple[str, ...] = ()
    """What is said of recordings in which the device moves: nothing here is about them."""
    besides: tuple[Any, ...] = ()
    """Results of further tasks that shared the cores."""


def study_recordings(
    recordings: Sequence[ImuRecording],
    models: Mapping[str, ThermalModel] | None = None,
    *,
    attitudes: bool = True,
    diagnosis: bool = True,
    catalogue: Mapping[str, type[Effect]] = EFFECTS,
    workers: int = 1,
    besides: Sequence[Task] = (),
) -> Study:
    """Return the study of the recordings; a device without a given model is fitted a line.

    Recordings of a moving device are left out; MovingError where nothing else is there.
    `attitudes` False leaves the orientation filters out, `diagnosis` False the search for missing
    effects of the catalogue; `workers` processes share the work, and do the tasks `besides` with
    it.
    """
    doubt = doubt_of(UNNAMED, recordings)
    recordings, left_out = resting(named(recordings))
    given = models or {}
    prepared: list[PreparedRun] = []
    devices: dict[str, StudiedDevice] = {}
    for device in dict.fromkeys(r.device for r in recordings):
        show_progress(f'fitting {device} …')
        own = [r for r in recordings if r.device == device]
        devices[device], runs = study_device(device, own, given.get(device))
        prepared += runs
        if device == UNNAMED:
            devices[device] = replace(devices[device], note=doubt)
    lines = {d.name: d.model for d in devices.values() if d.model and d.name not in given}
    filtering: list[Task] = []
    if attitudes:
        filtering = [AttitudeTask(r, devices[r.device].model, len(recordings)) for r in recordings]
    judging: list[Task] = []
    if diagnosis:
        judging = [
            DiagnosisTask(
                d.name, [r for r in recordings if r.device == d.name], d.model, catalogue
            )
            for d in devices.values()
            if d.model
        ]
    tasks = (*filtering, *judging, PoolingTask(prepared, lines), *besides)
    results = run_tasks(tasks, workers)
    found = results[: len(filtering)] or [()] * len(recordings)
    rest = results[len(filtering) :]
    judged = rest[: len(judging)]
    for failed in (j for j in judged if 'problem' in j):
        known = devices[failed['device']]
        said = '; '.join(filter(None, (known.note, failed['problem'])))
        devices[known.name] = replace(known, note=said)
    by_name = {run.name: run for run in prepared}
    studied = [
        study_run(recording, devices[recording.device].model, by_name.get(recording.run), angles)
        for recording, angles in zip(recordings, found, strict=True)
    ]
    show_progress('')
    return Study(
        tuple(studied),
        tuple(devices.values()),
        rest[len(judging)],
        slopes_of(studied),
        {j['device']: j for j in judged if 'problem' not in j},
        tuple(left_out),
        tuple(rest[len(judging) + 1 :]),
    )


def named(recordings: Sequence[ImuRecording]) -> list[ImuRecording]:
    """Return the recordings with a run name each, unique, and a device name."""
    seen: dict[str, int] = {}
    result = []
    for recording in recordings:
        name = recording.run or recording.source.rstrip('/').rpartition('/')[2] or 'run'
        seen[name] = seen.get(name, 0) + 1
        unique = name if seen[name] == 1 else f'{name} ({seen[name]})'
        device = recording.device or recording.namespace.strip('/') or UNNAMED
        result.append(replace(recording, run=unique, device=device))
    return result


def doubt_of(name: str, recordings: Sequence[ImuRecording]) -> str:
    """Return what is said of several bags that name no device: they are taken as one."""
    unnamed = [r.source or r.run for r in recordings if not r.device and not r.namespace]
    if len(unnamed) < 2:
        return ''
    return (
        f'{len(unnamed)} bags name no device and are taken as one, {name!r}: right for one '
        'device in several runs, wrong for several; then report them one at a time'
    )


def study_device(
    name: str, recordings: Sequence[ImuRecording], model: ThermalModel | None
) -> tuple[StudiedDevice, list[PreparedRun]]:
    """Return model and comparison of one device; what stands in the way is its `problem`."""
    try:
        runs = prepare(recordings)
        model = model or fit_prepared([BiasTemperature()], runs)
        older = tuple(compare_prepared(version, runs) for version in model.history)
        return StudiedDevice(name, model, compare_prepared(model, runs), older), runs
    except UserError as error:
        if not isinstance(error, ModelError) and model is not None:
            raise
        return StudiedDevice(name, None, None, problem=str(error)), []


def study_run(
    recording: ImuRecording,
    model: ThermalModel | None,
    prepared: PreparedRun | None,
    attitudes: tuple[Attitude, ...],
) -> StudiedRun:
    """Return what follows from one recording under a model."""
    return StudiedRun(
        name=recording.run,
        device=recording.device,
        recording=recording,
        kept=settled(recording),
        hash=prepared.hash if prepared else columns_hash(recording),
        errors=errors_of_run(prepared, model) if prepared and model else None,
        attitudes=attitudes,
        interpolated=is_slow(recording),
    )


def slopes_of(runs: Sequence[StudiedRun]) -> dict[str, dict[str, dict[str, FloatArray]]]:
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
    """The recordings of one device and the model to be judged."""

    device: str
    recordings: Sequence[ImuRecording]
    model: ThermalModel
    catalogue: Mapping[str, type[Effect]] = field(default_factory=lambda: EFFECTS)

    @property
    def label(self) -> str:
        """What is diagnosed."""
        return f'diagnosing {self.device}'

    @property
    def size(self) -> float:
        """As long as filtering so many rows [10⁶]."""
        return 3.0 + 1.5e-6 * sum(map(len, self.recordings))

    def run(self) -> dict[str, Any]:
        """Return the diagnosis as plain values, with `steps` where effects can be added.

        Where the recordings cannot be diagnosed, `problem` says why and nothing else is there.
        """
        try:
            content = diagnose(self.recordings, self.model, catalogue=self.catalogue).to_dict()
        except ModelError as error:
            return {'device': self.device, 'problem': f'not diagnosed: {error}'}
        steps: list[dict[str, Any]] = []
        if any(finding['kind'] == 'effect' for finding in content['findings']):
            runs = prepare(check_quality(self.recordings)[0])
            steps = [
                step.to_dict() for step in grow(self.model, runs, Settings(self.catalogue)).steps
            ]
        return content | {'steps': steps}


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
