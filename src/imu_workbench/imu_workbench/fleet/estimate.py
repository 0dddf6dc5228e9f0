# SPDX-License-Identifier: Apache-2.0
"""One device of a fleet: its bags in, its rows out. This is what a worker runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from imu_recording.plausibility import admitted
from imu_recording.recording import SENSOR_UNITS, FloatArray, RecordingError, columns_hash
from numpy.typing import NDArray
from thermal_comp.comparison.compare import Comparison, compare_prepared
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.motion import refuse_moving
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.user_effects import EffectError, effect_catalogue, effects_hash
from thermal_comp.fitting.fit import fit_prepared, package_version
from thermal_comp.model.values import SensorModel, ThermalModel

from imu_recording import ImuRecording, read_bag
from imu_workbench.fleet.candidates import try_candidates
from imu_workbench.fleet.sources import DeviceSource, reason
from imu_workbench.fleet.table import SCHEMA, ResultRow

BIN_K = 1.0
"""Width of the bins of temperature that block means are kept in [K]."""
BIN_TIME_SHARES = (1.0, 0.5, 0.25)
"""Shares of a bin's time, from its beginning, with a mean each: they stand for shorter dwells."""
LINE_EFFECT = BiasTemperature()
"""The model of every device: the paper's line per axis."""


@dataclass(frozen=True)
class EstimateSettings:
    """What the rows of a device depend on beside its bags."""

    diagnose: bool = False
    """Also diagnose each device by itself."""
    effects: tuple[str, ...] = ()
    """Paths of files and folders with a user's effects, the same on every host."""
    effects_hash: str = ''
    """SHA-256 of those files when the run began; '' without any."""
    schema: int = SCHEMA

    @classmethod
    def of(cls, effects: Sequence[Path] = (), *, diagnose: bool = False) -> EstimateSettings:
        """Return the settings with these files and folders of a user's effects."""
        paths = tuple(str(path.resolve()) for path in effects)
        return cls(diagnose, paths, effects_hash(paths) if paths else '')

    @property
    def hash(self) -> str:
        """SHA-256 of the settings; of effects their code, wherever it stands, not the paths."""
        settings = asdict(self)
        del settings['effects']
        if not self.effects:
            del settings['effects_hash']
        return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()


@cache
def version() -> str:
    """Return the version of the package that estimates."""
    return package_version()


def _catalogue(settings: EstimateSettings) -> Mapping[str, type[Effect]]:
    if not settings.effects:
        return effect_catalogue()
    return _with_files(settings.effects, settings.effects_hash)


@cache
def _with_files(files: tuple[str, ...], expected_hash: str) -> Mapping[str, type[Effect]]:
    """Return the catalogue with the effects of files, which a worker checks once."""
    if effects_hash(files) != expected_hash:
        raise EffectError(f'{", ".join(files)}: not what it was when the run began, on this host')
    return effect_catalogue(files)


def estimate_device(source: DeviceSource, settings: EstimateSettings) -> list[ResultRow]:
    """Return the rows of one device; one row with the reason where it cannot be estimated."""
    try:
        recordings = [admitted(one) for one in _recordings(source)]
        rows = _estimated(recordings, settings)
        device = source.device or recordings[0].device or Path(source.key.split('#')[0]).name
        digest = hashlib.sha256(''.join(columns_hash(r) for r in recordings).encode()).hexdigest()
    except Exception as error:  # noqa: BLE001 (one device in thousands never ends the run)
        elsewhere = any(
            isinstance(one, OSError | EffectError) for one in (error, error.__context__)
        )
        return [failed_row(source, settings, reason(error), again=elsewhere)]
    identity = _identity(source, settings, device, digest)
    return [{**row, **identity} for row in rows]


def failed_row(
    source: DeviceSource, settings: EstimateSettings, reason: str, *, again: bool = False
) -> ResultRow:
    """Return the row of a device that has no estimate; `again`: the next run tries once more."""
    device = source.device or Path(source.key.split('#')[0]).name
    row = {'role': 'failed', 'reason': reason, **_identity(source, settings, device, '')}
    return {**row, 'fingerprint': ''} if again else row


def _identity(
    source: DeviceSource, settings: EstimateSettings, device: str, input_hash: str
) -> ResultRow:
    return {
        'lot': source.lot,
        'type': source.type,
        'device': device,
        'source': source.key,
        'fingerprint': source.fingerprint,
        'input_hash': input_hash,
        'settings': settings.hash,
        'version': version(),
    }


def _recordings(source: DeviceSource) -> Iterator[ImuRecording]:
    for bag in source.bags:
        with _local(bag) as path:
            recording = read_bag(path)
        if source.device and recording.device and recording.device != source.device:
            raise RecordingError(f'{bag}: holds {recording.device}, not {source.device}')
        refuse_moving(recording)
        yield recording


@contextmanager
def _local(url: str) -> Iterator[Path]:
    """Give a path where the bag of a URL can be read; a remote one is copied meanwhile."""
    if '://' not in url:
        yield Path(url)
        return
    from fsspec.core import url_to_fs

    files, path = url_to_fs(url)
    with TemporaryDirectory() as folder:
        target = Path(folder) / path.rstrip('/').rpartition('/')[2]
        files.get(path, str(target), recursive=True)
        yield target


def _estimated(recordings: Sequence[ImuRecording], settings: EstimateSettings) -> list[ResultRow]:
    named = {recording.device for recording in recordings if recording.device}
    if len(named) > 1:
        raise RecordingError(f'its bags name several devices: {", ".join(sorted(named))}')
    catalogue = _catalogue(settings)
    runs = prepare(recordings)
    model = fit_prepared([LINE_EFFECT], runs)
    comparison = compare_prepared(model, runs)
    noise = {s: part.noise for s in SENSORS if (part := model.sensors.get(s)) and part.noise}
    alone = [fit_prepared([LINE_EFFECT], [run], noise=noise) for run in runs]
    rows: list[ResultRow] = []
    for sensor in (sensor for sensor in SENSORS if sensor in model.sensors):
        part = model.sensors[sensor]
        fitted = _fitted_rows(sensor, part, runs, alone, comparison)
        rows += [{**row, 'measured_at': int(recordings[0].stamp[0])} for row in fitted]
        rows += _candidate_rows(sensor, part, runs, catalogue)
    if settings.diagnose:
        rows += _diagnosed_rows(recordings, model, catalogue)
    return rows


def _fitted_rows(
    sensor: Sensor,
    part: SensorModel,
    runs: Sequence[PreparedRun],
    alone: Sequence[ThermalModel],
    comparison: Comparison,
) -> list[ResultRow]:
    """Return a row per axis: slope, its deviation, that of each run, means by temperature."""
    compared = comparison.sensors[sensor]
    slopes = part.coefficients[0]
    std = np.sqrt(np.diag(part.covariance)).reshape(slopes.shape)
    each = [one.sensors[sensor].coefficients[0][0] for one in alone if sensor in one.sensors]
    blocks = block_means(runs, sensor, part)
    return [
        {
            'sensor': sensor,
            'axis': axis,
            'effect': LINE_EFFECT.name,
            'role': 'fitted',
            'unit': f'{SENSOR_UNITS[sensor]}/K',
            'coefficients': slopes[:, a].tolist(),
            'std': std[:, a].tolist(),
            'run_coefficients': [float(one[a]) for one in each],
            'measured_rms': float(compared.measured_rms[a]),
            'held_out_rms': float(compared.held_out_rms[a]),
            'noise_floor': float(compared.noise_floor[a]),
            'block_run': blocks['run'].tolist(),
            'block_share': blocks['share'].tolist(),
            'block_temperature': blocks['temperature'].tolist(),
            'block_mean': blocks['mean'][:, a].tolist(),
            'block_variance': blocks['variance'][:, a].tolist(),
            'block_seconds': blocks['seconds'].tolist(),
        }
        for a, axis in enumerate('xyz')
    ]


def block_means(
    runs: Sequence[PreparedRun], sensor: Sensor, part: SensorModel
) -> dict[str, NDArray[Any]]:
    """Return run, share, temperature [°C], seconds (n,), mean and variance (n, 3) of each bin.

    A bin is BIN_K wide and has an entry for every share of the time the run spent in it; the
    variance [unit²] is that of a mean over as long.
    """
    assert part.noise is not None  # noqa: S101 (a fitted model has it)
    names = ('run', 'share', 'temperature', 'seconds', 'mean', 'variance')
    found: dict[str, list[Any]] = {name: [] for name in names}
    for r, run in enumerate(runs):
        measured = run.measured[sensor]
        valid = run.valid(sensor)
        place = np.round(run.temperature / BIN_K).astype(int)
        for bin_ in np.unique(place[valid]):
            inside = np.flatnonzero(valid & (place == bin_))
            for share in BIN_TIME_SHARES:
                rows = inside[: ceil(share * len(inside))]
                seconds = float(len(rows) * run.period)
                found['run'].append(r)
                found['share'].append(share)
                found['temperature'].append(float(run.temperature[rows].mean()))
                found['seconds'].append(seconds)
                found['mean'].append(measured[rows].mean(axis=0))
                found['variance'].append(part.noise.variance_of_means(seconds))
    return {name: np.array(values) for name, values in found.items()}


def _candidate_rows(
    sensor: Sensor,
    part: SensorModel,
    runs: Sequence[PreparedRun],
    catalogue: Mapping[str, type[Effect]],
) -> list[ResultRow]:
    """Return a row per effect and axis: what each of its forms would take up."""
    assert part.noise is not None  # noqa: S101 (a fitted model has it)
    return [
        {
            'sensor': sensor,
            'axis': axis,
            'effect': found.effect,
            'role': 'candidate',
            'forms': list(found.forms),
            'gain': found.delta_chi2[:, a].tolist(),
            'degrees': found.degrees,
            'shapes': list(found.shapes) or None,
            'coefficients': _of_axis(found.coefficients, a),
            'std': _of_axis(found.std, a),
        }
        for found in try_candidates(runs, sensor, part.noise, LINE_EFFECT, catalogue)
        for a, axis in enumerate('xyz')
    ]


def _of_axis(values: FloatArray | None, axis: int) -> list[float] | None:
    return None if values is None else [float(value) for value in values[:, axis]]


def _diagnosed_rows(
    recordings: Sequence[ImuRecording],
    model: ThermalModel,
    catalogue: Mapping[str, type[Effect]],
) -> list[ResultRow]:
    found = diagnose(recordings, model, catalogue=catalogue)
    return [
        {
            'sensor': finding.sensor,
            'axis': '',
            'effect': finding.name or finding.kind,
            'role': 'diagnosed',
            'probability': finding.probability,
        }
        for finding in found.findings
    ]
