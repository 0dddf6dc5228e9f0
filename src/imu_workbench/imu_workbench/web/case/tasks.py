# SPDX-License-Identifier: Apache-2.0
"""Tasks of the worker processes: read, fit, compare, diagnose, add, remove, report.

Every task takes `progress` first and returns plain data; effects of users are loaded from their
files again in each process.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from imu_recording.plausibility import admitted
from imu_recording.recording import RecordingError
from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.blocks import in_common_blocks
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.preparation import as_campaign, prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.diagnose import Settings, diagnose_inputs, greyed_out
from thermal_comp.diagnosis.growth import add_effect
from thermal_comp.diagnosis.inputs import prepare_inputs
from thermal_comp.diagnosis.model_form import with_model_form
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.explanation import explanation
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.inputs import usable_sensors
from thermal_comp.model.file import check_device
from thermal_comp.model.values import ModelError, ThermalModel

from imu_workbench.answer import plain
from imu_workbench.bag_devices import read_devices
from imu_workbench.case import file_state
from imu_workbench.web.case.candidates import candidates_of, with_errors
from imu_workbench.web.case.stored_bag import StoredBag, store_recording
from imu_workbench.web.case.version import Version, make_version, model_from_text


class ProgressListener(Protocol):
    """Takes what is being done, and the share of all that is done; 0 where it is not known."""

    def __call__(self, text: str, share: float = 0.0) -> None:
        """Take the progress."""


def read_task(
    progress: ProgressListener, path: Path, folder: Path, remap: Mapping[str, str]
) -> list[StoredBag]:
    """Read a bag and store the recording of each of its devices in a folder below `folder`.

    `remap` maps names of the logging contract to names in the bag.
    """
    progress('reading')
    stored, state = [], file_state(path)
    for number, recording in enumerate(read_devices(path, None, remap, every_device=True)):
        stored.append(store_recording(admitted(recording), folder / str(number), state))
    return stored


def prepare_task(progress: ProgressListener, bags: Sequence[StoredBag], target: Path) -> Path:
    """Prepare the runs of one device and keep them in a file; runs that cannot be are left out.

    The file appears when it is complete: nobody ever reads a part of it.
    """
    runs: list[PreparedRun] = []
    left_out: dict[str, str] = {}
    for number, bag in enumerate(bags):
        progress(f'taking block means of {bag.run}', number / (len(bags) + 1))
        try:
            runs += usable(prepare([bag.recording()]))
        except RecordingError as error:
            left_out[bag.run] = f'{Path(bag.source).name}: {error}'
    if not runs:
        raise RecordingError('; '.join(left_out.values()))
    part = target.with_suffix(f'.{os.getpid()}')
    with part.open('wb') as file:
        pickle.dump((as_campaign(in_common_blocks(runs)), left_out), file, protocol=5)
    return part.replace(target)


def usable(runs: list[PreparedRun]) -> list[PreparedRun]:
    """Return the runs; refuse one that is too short for any sensor."""
    for run in runs:
        try:
            usable_sensors([run])
        except ModelError:
            raise RecordingError(
                f'{run.name}: no sensor has enough samples in its {len(run)} blocks'
            ) from None
    return runs


@dataclass(frozen=True, eq=False)
class Opened:
    """A version, and what the runs allow."""

    version: Version
    unusable: dict[str, str]
    """Effect → why it cannot be fitted to these runs."""
    left_out: dict[str, str]
    """Run → why it is left out."""
    hashes: dict[str, str]
    """Run → SHA-256 of its columns."""


def version_task(
    progress: ProgressListener,
    prepared: Path,
    model_text: str | None,
    label: str,
    effect_files: Sequence[Path],
) -> Opened:
    """Return the given model, else a line per axis, against the runs."""
    catalogue = effect_catalogue(effect_files)
    runs, left_out = load_prepared(prepared)
    if model_text is None:
        progress('fitting a line per axis')
        model = fit_prepared([BiasTemperature()], runs)
    else:
        model = model_from_text(model_text, catalogue)
        for run in runs:
            check_device(model, run.device)
    progress('comparing')
    version = make_version(label, model, compare_prepared(model, runs), runs)
    hashes = {run.name: run.hash for run in runs}
    return Opened(version, greyed_out(runs, catalogue), left_out, hashes)


@dataclass(frozen=True)
class Change:
    """What is to be changed in a model."""

    effect: str
    sensors: tuple[Sensor, ...] = ()
    """Empty: where there is evidence when added, everywhere when removed."""
    added: bool = True
    """False: taken out."""


def change_task(
    progress: ProgressListener,
    prepared: Path,
    model_text: str,
    change: Change,
    effect_files: Sequence[Path],
) -> Version:
    """Return the model with an effect more or less, everything refitted."""
    catalogue = effect_catalogue(effect_files)
    runs = load_runs(prepared)
    model = model_from_text(model_text, catalogue)
    effect_name = change.effect.replace('_', ' ')
    if not change.added:
        progress(f'removing {effect_name}')
        return _without(model, runs, change, coupled=catalogue[change.effect].coupled)
    progress(f'adding {effect_name}')
    growth = add_effect(model, runs, change.effect, Settings(catalogue), change.sensors)
    places = ', '.join(sensor for step in growth.steps for sensor in step.sensors)
    label = f'+ {change.effect} ({places})'
    return make_version(label, growth.model, growth.after, runs, growth.unneeded)


def _without(
    model: ThermalModel, runs: Sequence[PreparedRun], change: Change, *, coupled: bool
) -> Version:
    places = change.sensors if change.sensors and not coupled else SENSORS
    listed = {
        sensor: tuple(
            e
            for e in model.sensors[sensor].effects
            if not (e.name == change.effect and sensor in places)
        )
        for sensor in SENSORS
        if sensor in model.sensors
    }
    noise = {s: p.noise for s in SENSORS if (p := model.sensors.get(s)) and p.noise is not None}
    fitted = with_model_form(fit_prepared(listed, runs, noise=noise), runs)
    label = f'− {change.effect} ({", ".join(places)})'
    return make_version(label, model.succeeded_by(fitted), compare_prepared(fitted, runs), runs)


def diagnose_task(
    progress: ProgressListener,
    bags: Sequence[StoredBag],
    prepared: Path,
    model_text: str,
    effect_files: Sequence[Path],
) -> dict[str, Any]:
    """Return what `diagnose --json` writes, and the candidates of every sensor.

    `prepared` holds the runs of the bags, which are taken where nothing is defective.
    """
    progress('looking for defects of the data')
    catalogue = effect_catalogue(effect_files)
    model = model_from_text(model_text, catalogue)
    runs = load_runs(prepared)
    same = [run.name for run in runs] == [bag.run for bag in bags]
    recordings = (bag.recording() for bag in bags)
    inputs = prepare_inputs(recordings, prepared=runs if same else ())
    found = diagnose_inputs(inputs, model, catalogue, progress=progress)
    content: dict[str, Any] = plain(found.to_dict())
    rows = {s: [asdict(one) for one in own] for s, own in candidates_of(found).items()}
    return {'diagnosis': content, 'candidates': plain(rows)}


def held_out_task(
    progress: ProgressListener,
    prepared: Path,
    model_text: str,
    candidates: Mapping[str, Sequence[Mapping[str, Any]]],
    effect_files: Sequence[Path],
) -> dict[str, Any]:
    """Return the candidates of every sensor, those in front with what they leave held out."""
    catalogue = effect_catalogue(effect_files)
    model = model_from_text(model_text, catalogue)
    found: dict[str, Any] = plain(
        with_errors(candidates, model, load_runs(prepared), catalogue, progress)
    )
    return found


def load_runs(prepared: Path) -> list[PreparedRun]:
    """Return the runs that `prepare_task` kept."""
    return load_prepared(prepared)[0]


def load_prepared(prepared: Path) -> tuple[list[PreparedRun], dict[str, str]]:
    """Return the runs that `prepare_task` kept, and why others are left out, by run."""
    with prepared.open('rb') as file:
        kept: tuple[list[PreparedRun], dict[str, str]] = pickle.load(file)  # noqa: S301 (our own)
    return kept


def report_task(
    progress: ProgressListener,
    bags: Sequence[StoredBag],
    model_texts: Mapping[str, str],
    effect_files: Sequence[Path],
    folder: Path,
    target: Path,
) -> Path:
    """Write the report of these recordings under these models (by device); return its path.

    `folder` is that of the case: what a laboratory stated stands there.
    """
    # Imported here: the libraries of a report take as long to import as those of a verdict.
    from imu_workbench.case_statements import statement_files, statements_of
    from imu_workbench.report.analysis import analyse_recordings
    from imu_workbench.report.content import report_content, versions
    from imu_workbench.report.html.document import report_page

    progress('writing the report: filters, diagnosis, figures')
    catalogue = effect_catalogue(effect_files)
    models = {device: model_from_text(text, catalogue) for device, text in model_texts.items()}
    recordings = [bag.recording() for bag in bags]
    analysis = analyse_recordings(
        recordings, models, catalogue=catalogue, workers=os.cpu_count() or 1
    )
    names = ' '.join(bag.source for bag in bags)
    given = [f'--model {device}.yaml' for device in models]
    given += [f'--effects {file.name}' for file in effect_files]
    given += [f'--{file.stem} {file.name}' for file in statement_files(folder)]
    command = f'python -m imu_workbench report {names} {" ".join(given)} -o report.html'
    laboratory, limits = statements_of(folder)
    content = report_content(
        analysis, commands=[command], versions=versions(), laboratory=laboratory, limits=limits
    )
    target.write_text(report_page(content), 'utf-8')
    return target


def effect_explanations(catalogue: Mapping[str, type[Effect]]) -> dict[str, dict[str, Any]]:
    """Return what `explain` says of every effect, by name."""
    return {
        name: explanation(effect) | {'coupled': effect.coupled, 'searched': effect.searched}
        for name, effect in catalogue.items()
    }


def effects_task(progress: ProgressListener, files: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Return the explanations of all effects, those of the files checked against the contract."""
    progress('checking the file')
    return effect_explanations(effect_catalogue(files))
