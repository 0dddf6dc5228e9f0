# SPDX-License-Identifier: Apache-2.0
"""The Python face of the package: read, fit, compare, diagnose, add, compensate, load, save.

`recordings` is one recording, several, or what `read` takes: paths and globs of bags. Where no
model is given, the line per axis of Betta et al. 2022 is fitted first.
"""

from __future__ import annotations

import glob
from collections.abc import Collection, Iterable, Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TypeAlias, overload

from imu_recording.bags.files import GLOB_SIGNS
from imu_recording.plausibility import admitted
from imu_recording.user_error import did_you_mean

from imu_recording import BagError, ImuRecording, bag_namespaces, read_bag
from thermal_comp.comparison.compare import Comparison, compare_prepared
from thermal_comp.compensation.recording import compensate as compensate_recording
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.motion import noted
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import Settings
from thermal_comp.diagnosis.diagnose import diagnose as diagnose_recordings
from thermal_comp.diagnosis.grown_model import Growth
from thermal_comp.diagnosis.growth import add_effect
from thermal_comp.diagnosis.result import Diagnosis
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit as fit_recordings
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.file import check_device, load_model, save_model
from thermal_comp.model.values import ModelError, ThermalModel

__all__ = ['add', 'compare', 'compensate', 'diagnose', 'fit', 'load', 'read', 'save']

PathLikes: TypeAlias = str | PathLike[str]
Recordings: TypeAlias = ImuRecording | PathLikes | Iterable[ImuRecording | PathLikes]
EffectLike: TypeAlias = str | Effect | type[Effect]
"""A name of the catalogue, an effect, or its class."""
EffectList: TypeAlias = EffectLike | Sequence[EffectLike]

FIRST_EFFECT = BiasTemperature
"""The effect a model starts from: the paper's line per axis."""


def read(
    *paths: PathLikes, namespace: str | None = None, accept: Collection[str] = ()
) -> list[ImuRecording]:
    """Read bags: paths of folders or files, and globs; one recording per bag, in order.

    `namespace` chooses the device where a bag holds several. Raises BagError, which says what is
    there, where a path or glob names no bag, and RecordingError where numbers cannot be SI units
    or were compensated before, unless `accept` names 'units' or 'compensated'. A recording of a
    moving device says so in its notes.
    """
    if not paths:
        raise BagError('no bag given: name a folder, a file or a glob, e.g. "bags/dut1_?"')
    return [
        noted(admitted(_read_one(path, namespace), accept))
        for pattern in paths
        for path in _expanded(pattern)
    ]


def fit(
    recordings: Recordings,
    effects: EffectList | Mapping[Sensor, EffectList] = FIRST_EFFECT,
    *,
    pooled: bool = False,
    catalogue: Mapping[str, type[Effect]] = EFFECTS,
) -> ThermalModel:
    """Return the thermal model of these effects that fits the recordings of one device best.

    `effects` is one list for all sensors (each takes those that act on it), or one per sensor.
    `pooled` fits one set of coefficients to several devices. `catalogue` holds the effects that
    may be named; `thermal_comp.effects.user_effects` adds files.
    """
    chosen: Sequence[Effect] | Mapping[Sensor, Sequence[Effect]]
    if isinstance(effects, Mapping):
        chosen = {sensor: _effects(listed, catalogue) for sensor, listed in effects.items()}
    else:
        chosen = _effects(effects, catalogue)
    return fit_recordings(chosen, _recordings(recordings), pooled=pooled)


def compare(recordings: Recordings, model: ThermalModel | None = None) -> Comparison:
    """Return measured against modelled error per axis: rms, held out, noise floor, where."""
    runs = prepare(_recordings(recordings, model))
    return compare_prepared(model or fit_prepared([FIRST_EFFECT()], runs), runs)


def diagnose(
    recordings: Recordings,
    model: ThermalModel | None = None,
    *,
    catalogue: Mapping[str, type[Effect]] = EFFECTS,
) -> Diagnosis:
    """Return which physical effect is missing in the model, that none is, or that none fits.

    `catalogue` holds the effects that are tried; `thermal_comp.effects.user_effects` adds files.
    """
    return diagnose_recordings(_recordings(recordings, model), model, catalogue=catalogue)


def add(
    recordings: Recordings,
    effect: EffectLike | Diagnosis,
    model: ThermalModel | None = None,
    *,
    sensors: Sequence[Sensor] = (),
    catalogue: Mapping[str, type[Effect]] = EFFECTS,
) -> Growth:
    """Return the model with an effect added and refitted, and how far the held-out error fell.

    `effect` may be a diagnosis: its strongest named effect is added where it was found. Without
    `sensors` an effect goes where its evidence is above its threshold. Shape parameters are
    searched, whatever values an effect comes with. Raises ModelError where it cannot be added.
    """
    if isinstance(effect, Diagnosis):
        effect, sensors = _strongest(effect, sensors, catalogue)
    name = effect if isinstance(effect, str) else effect.name
    known = dict(catalogue)
    if not isinstance(effect, str):
        known[name] = effect if isinstance(effect, type) else type(effect)
    runs = prepare(_recordings(recordings, model))
    return add_effect(model, runs, name, Settings(known), sensors)


@overload
def compensate(recordings: ImuRecording, model: ThermalModel) -> ImuRecording: ...
@overload
def compensate(
    recordings: PathLikes | Iterable[ImuRecording | PathLikes], model: ThermalModel
) -> list[ImuRecording]: ...
def compensate(recordings: Recordings, model: ThermalModel) -> ImuRecording | list[ImuRecording]:
    """Return the recordings with the modelled error subtracted; one for one, a list for more."""
    if isinstance(recordings, ImuRecording):
        return compensate_recording(recordings, model)
    return [compensate_recording(recording, model) for recording in _recordings(recordings)]


def load(path: PathLikes, *, catalogue: Mapping[str, type[Effect]] = EFFECTS) -> ThermalModel:
    """Read a model file; raise ModelError that names the file, the field and what is expected."""
    return load_model(path, catalogue)


def save(model: ThermalModel | Growth, path: PathLikes) -> None:
    """Write a model, or the model of a growth, as YAML; reading it back gives the same bits."""
    save_model(model.model if isinstance(model, Growth) else model, path)


def _expanded(pattern: PathLikes) -> list[Path]:
    text = fspath(pattern)
    if Path(text).exists() or not GLOB_SIGNS & set(text):
        return [Path(text)]
    found = sorted(glob.glob(text))  # noqa: PTH207 (a pattern may be absolute)
    if not found:
        raise BagError(f'{text}: no bag matches in {Path.cwd()}')
    return [Path(path) for path in found]


def _read_one(path: Path, namespace: str | None) -> ImuRecording:
    if namespace is None:
        names = bag_namespaces(path)
        if len(names) > 1:
            raise BagError(
                f'{path} holds several devices: {", ".join(names)}; '
                f'choose one, e.g. read(…, namespace={names[0]!r})'
            )
    return read_bag(path, namespace=namespace)


def _recordings(given: Recordings, model: ThermalModel | None = None) -> list[ImuRecording]:
    """Return the recordings, read where they are paths; refuse a device `model` is not of."""
    if isinstance(given, ThermalModel):
        raise ModelError(
            'a model stands where recordings belong: they come first, as in '
            'compare(recordings, model)'
        )
    recordings: list[ImuRecording] = []
    for item in [given] if isinstance(given, ImuRecording | str | PathLike) else given:
        recordings += [item] if isinstance(item, ImuRecording) else read(item)
    for recording in recordings:
        check_device(model, recording.device)
    return recordings


def _effects(given: EffectList, catalogue: Mapping[str, type[Effect]]) -> list[Effect]:
    listed = [given] if isinstance(given, str | Effect | type) else list(given)
    return [_effect(item, catalogue) for item in listed]


def _effect(given: EffectLike, catalogue: Mapping[str, type[Effect]]) -> Effect:
    if isinstance(given, str):
        if given not in catalogue:
            near = did_you_mean(given, catalogue)
            raise ModelError(f'effect {given!r} is not known{near}; known: {", ".join(catalogue)}')
        return catalogue[given]()
    return given() if isinstance(given, type) else given


def _strongest(
    found: Diagnosis, sensors: Sequence[Sensor], catalogue: Mapping[str, type[Effect]]
) -> tuple[str, Sequence[Sensor]]:
    """Return the name and the sensors of the strongest effect a diagnosis names."""
    for finding in found.findings:
        if finding.kind == 'effect' and finding.name is not None and finding.name in catalogue:
            own = [s for s in SENSORS if s in finding.sensor.split('+')]
            return finding.name, sensors or own
    raise ModelError(
        f'the diagnosis of {found.device or "the device"} names no effect that could be added '
        f'(verdict: {found.verdict}); name one: add(recordings, "thermal_lag")'
    )
