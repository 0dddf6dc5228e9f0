# SPDX-License-Identifier: Apache-2.0
"""Effects of other people: from a file, or from the entry points of installed packages."""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import sys
import traceback
import zlib
from collections.abc import Collection, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path

from imu_recording.user_error import UserError

from thermal_comp.effects import EFFECTS
from thermal_comp.effects.contract import USER_MODULES, check_effect
from thermal_comp.effects.effect import Effect

ENTRY_POINT_GROUP = 'thermal_comp.effects'
"""Entry point group; each entry is an Effect class."""


class EffectError(UserError):
    """An effect that cannot be used; the message names the file and what is wrong."""


def effect_catalogue(files: Sequence[str | Path] = ()) -> Mapping[str, type[Effect]]:
    """Return the catalogue with the effects of entry points and files added.

    Every added effect has to keep the contract; a name of the catalogue cannot be taken, but a
    file of the catalogue, or a copy of one, is welcome.
    """
    catalogue = dict(EFFECTS)
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        effect = entry.load()
        _include(catalogue, effect, f'entry point {entry.name}', {*catalogue, effect.name})
    for file in _listed(files):
        found = effects_in_file(file)
        known = {*catalogue, *(effect.name for effect in found)}
        for effect in found:
            _include(catalogue, effect, str(file), known)
    return catalogue


def _listed(files: Sequence[str | Path]) -> list[Path]:
    """Return the files, those of a folder in order."""
    listed: list[Path] = []
    for path in map(Path, files):
        listed += sorted(path.glob('*.py')) if path.is_dir() else [path]
    return listed


def source_of(effect: Effect | type[Effect]) -> dict[str, str] | None:
    """Return file and hash of an effect's source; None for an effect of the catalogue.

    A model file names by them the code that its coefficients belong to; it never contains code.
    """
    kind = effect if isinstance(effect, type) else type(effect)
    if EFFECTS.get(kind.name) is kind:
        return None
    file = Path(inspect.getfile(kind))
    return {'module': file.name, 'sha256': hashlib.sha256(file.read_bytes()).hexdigest()[:16]}


def effects_hash(files: Sequence[str | Path]) -> str:
    """Return the SHA-256 of the code in files of effects, those of a folder in order."""
    digest = hashlib.sha256()
    for file in _listed(files):
        try:
            digest.update(hashlib.sha256(file.read_bytes()).digest())
        except OSError as error:
            raise EffectError(f'{file}: cannot be read: {error.strerror}') from None
    return digest.hexdigest()


def effects_in_file(file: str | Path) -> list[type[Effect]]:
    """Return the Effect classes that a Python file defines."""
    path = Path(file)
    if not path.is_file():
        raise EffectError(f'{path}: no such file')
    name = f'{USER_MODULES}{path.stem}_{zlib.crc32(str(path.resolve()).encode()):08x}'
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise EffectError(f'{path}: not a Python file')
    module = importlib.util.module_from_spec(spec)
    # Where annotations are strings, dataclasses look their module up by its name.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # noqa: BLE001 (whatever the user's file does)
        sys.modules.pop(name, None)
        raise EffectError(
            f'{path}{_line_in(path, error)}: cannot be loaded: {_told(error)}'
        ) from None
    found = [
        item
        for _, item in inspect.getmembers(module, inspect.isclass)
        if issubclass(item, Effect) and item.__module__ == name and not item.guessed_channel
    ]
    if not found:
        raise EffectError(f'{path}: defines no subclass of thermal_comp.effects.Effect')
    return found


def _line_in(path: Path, error: BaseException) -> str:
    """Return ', line 3' where the error came from that line of the file; '' where unknown."""
    if isinstance(error, SyntaxError):
        return f', line {error.lineno}'
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == str(path)
    ]
    return f', line {lines[-1]}' if lines else ''


def _told(error: BaseException) -> str:
    if isinstance(error, SyntaxError):
        return error.msg
    return f'{type(error).__name__}: {error}'


def name_is_taken(effect: type[Effect], catalogue: Mapping[str, type[Effect]] = EFFECTS) -> bool:
    """Tell whether another effect of the catalogue has the name; a copy of its file has not."""
    known = catalogue.get(effect.name)
    return known is not None and _source(known) != _source(effect)


def _source(effect: type[Effect]) -> str:
    return inspect.getsource(inspect.getmodule(effect) or effect)


def _include(
    catalogue: dict[str, type[Effect]], effect: type[Effect], source: str, known: Collection[str]
) -> None:
    problems = check_effect(effect, known)
    if problems:
        raise EffectError(f'{source}: {"; ".join(problems)}')
    if name_is_taken(effect, catalogue):
        raise EffectError(f'{source}: the name {effect.name!r} is in the catalogue already')
    catalogue.setdefault(effect.name, effect)
