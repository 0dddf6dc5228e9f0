# SPDX-License-Identifier: Apache-2.0
"""Profile files (YAML, `schema: 1`): read, checked, and written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml
from imu_recording.user_error import did_you_mean

from chamber_profile.profile.check import ProfileError, checked_content
from chamber_profile.profile.unroll import signed_axis, unrolled_steps
from chamber_profile.profile.values import OnAbort, Profile, ProfileLimits, Record

SHIPPED_FOLDER = Path(__file__).parent / 'shipped'
"""Folder of the profiles that ship."""


def profile_names() -> list[str]:
    """Return the names of the profiles that ship."""
    return sorted(path.stem for path in SHIPPED_FOLDER.glob('*.yaml'))


def load_profile(name_or_path: str | Path) -> Profile:
    """Return the profile of a file, or the one that ships under a name.

    Raises ProfileError with everything that is wrong at once, each with its place in the file.
    """
    path = Path(name_or_path)
    shipped = SHIPPED_FOLDER / f'{name_or_path}.yaml'
    if path.parent == Path() and not path.suffix and shipped.is_file():
        path = shipped
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise ProfileError(
            f'profile {str(name_or_path)!r}: {reason}'
            f'{did_you_mean(path.stem, profile_names())}; a file, or one of '
            f'{", ".join(profile_names())}'
        ) from error
    return parse_profile(text, str(path))


def parse_profile(text: str, source: str = 'profile') -> Profile:
    """Return the profile of a YAML text; `source` begins every error's place."""
    return _profile(checked_content(text, source), text, source)


def profile_from_content(content: Mapping[str, Any], source: str = 'profile') -> Profile:
    """Return the profile of plain content, checked as the file that `profile_text` makes of it."""
    return parse_profile(profile_text(content), source)


def profile_text(content: Mapping[str, Any]) -> str:
    """Return the YAML text of a profile's content."""
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=99)


def _profile(content: Mapping[str, Any], text: str, source: str) -> Profile:
    record = dict(content.get('record', {}))
    if 'topics' in record:
        record['topics'] = tuple(record['topics'])
    return Profile(
        name=content['name'],
        limits=ProfileLimits(**_floats(ProfileLimits, content['limits'])),
        run_steps=unrolled_steps(content),
        on_abort=OnAbort(**_floats(OnAbort, content.get('on_abort', {}))),
        ambient_c=float(content.get('ambient_c', 20.0)),
        orientations=tuple(signed_axis(axis) for axis in content.get('orientations', ())),
        record=Record(**record),
        description=content.get('description', ''),
        norm=content.get('norm', ''),
        text=text,
        source=source,
    )


def _floats(kind: type, content: Mapping[str, Any]) -> dict[str, Any]:
    names = {item.name for item in fields(kind)}
    return {key: float(value) for key, value in content.items() if key in names}
