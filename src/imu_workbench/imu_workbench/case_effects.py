# SPDX-License-Identifier: Apache-2.0
"""Effect files that versions of a case need, kept in the case beside their models.

A file is code, and a case may come from elsewhere: a kept file is loaded without asking only where
a file of the same content was given to a server of this folder of cases before.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from imu_workbench.case import Case, CaseError, saved, write_atomically

ALLOWED_FILE = '.allowed_effects.json'
"""In the folder of the cases, not in a case: SHA-256 of the files that were given here."""


def digest(content: bytes) -> str:
    """Return the SHA-256 of a file's content."""
    return hashlib.sha256(content).hexdigest()


def with_effect_file(case: Case, file: Path) -> Case:
    """Return the case with a copy of an effect file; it is on disk."""
    content = file.read_bytes()
    key = digest(content)
    if kept_effects(case).get(key) == file.name:
        return case
    write_atomically(_kept_path(case, key, file.name), content.decode('utf-8'))
    kept = {**kept_effects(case), key: file.name}
    return saved(replace(case, settings={**case.settings, 'effects': kept}))


def kept_effects(case: Case) -> Mapping[str, str]:
    """Return the effect files of a case: SHA-256 → name."""
    kept = case.settings.get('effects')
    return kept if isinstance(kept, dict) else {}


def effect_file(case: Case, key: str) -> bytes:
    """Return a kept effect file; CaseError where it is gone or its content has changed."""
    path = _kept_path(case, key, kept_effects(case)[key])
    try:
        content = path.read_bytes()
    except OSError as error:
        raise CaseError(f'{path}: {error.strerror}; put it back, or load the file anew') from None
    if digest(content) != key:
        raise CaseError(f'{path}: not the file that was kept (SHA-256 {key[:16]}); put it back')
    return content


def _kept_path(case: Case, key: str, name: str) -> Path:
    return case.folder / 'effects' / key[:16] / Path(name).name


def allow(cases: Path, key: str) -> None:
    """Note that a file was given to a server of these cases: it is loaded without asking now."""
    allowed = allowed_in(cases)
    if key not in allowed:
        write_atomically(cases / ALLOWED_FILE, json.dumps([*allowed, key], indent=1))


def allowed_in(cases: Path) -> list[str]:
    """Return the SHA-256 of the files that are loaded without asking."""
    try:
        found = json.loads((cases / ALLOWED_FILE).read_text('utf-8'))
    except (OSError, ValueError):
        return []  # the user is asked again
    return found if isinstance(found, list) else []
