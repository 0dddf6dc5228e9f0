# SPDX-License-Identifier: Apache-2.0
"""Thermal test profiles: what the chamber shall do, as written in a YAML file (`schema: 1`)."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from chamber_profile.profile.check import ProfileError, checked_content

PROFILES = Path(__file__).parents[1] / 'profiles'
"""Folder of the profiles that ship."""

STEP_KINDS = ('precondition', 'ramp', 'dwell', 'final', 'operator')
OPERATOR_PHASE = 'operator'
"""What chamber/phase says while an operator is asked for something; no phase of a recording."""


@dataclass(frozen=True)
class Stabilise:
    """When a dwell may begin: something stays near the set-point for a while."""

    source: str = 'air'
    """What is watched: 'air', 'device' (thermocouple on the device) or 'thermocouple' (same)."""
    band_c: float = 2.0
    """Largest distance from the set-point [K]."""
    hold_s: float = 0.0
    """How long it must stay in the band [s]."""
    max_rate_c_per_min: float | None = None
    """Largest mean rate over `rate_window_s` [K/min]; None: not asked for."""
    rate_window_s: float = 300.0
    timeout_s: float = 3600.0
    on_timeout: str = 'abort'
    """'abort' (safe state), 'hold' (wait for the operator) or 'continue' (dwell anyway)."""


@dataclass(frozen=True)
class Limits:
    """What the chamber and the device may see; also programmed into the chamber itself."""

    air_min_c: float
    air_max_c: float
    rate_max_c_per_min: float
    device_min_c: float = -40.0
    device_max_c: float = 85.0


@dataclass(frozen=True)
class OnAbort:
    """The safe state: where to go, how fast, and when to give up getting there."""

    target_c: float = 20.0
    rate_c_per_min: float = 2.0
    timeout_s: float = 1800.0
    """Grace beyond the time the ramp itself takes [s]."""


@dataclass(frozen=True)
class Step:
    """One step of an unrolled profile: go to a temperature, settle, stay."""

    id: str
    kind: str
    """One of STEP_KINDS."""
    target_c: float
    rate_c_per_min: float
    """Rate at which the set-point goes to the target, if it is not there [°C/min]."""
    dwell_s: float = 0.0
    dwell_mode: str = 'guaranteed'
    """Dwell clock: 'free' never stops, 'guaranteed' stops out of band, 'restart' begins anew."""
    stabilise: Stabilise | None = None
    prompt: str = ''
    expected_s: float = 0.0
    """How long an operator step is expected to take; simulations confirm after it [s]."""
    phase: str = ''
    cycle: int = 0
    """1 … within the cycles, 0 outside."""
    orientation: str = ''
    """Sensor axis that points up, '+x' … '-z'; '' not stated, or the devices are being turned."""


@dataclass(frozen=True)
class Record:
    """What a recording of the run holds."""

    topics: tuple[str, ...] = ()
    """Empty: everything."""
    split: str = 'phase'
    chamber_period_s: float = 1.0
    """Period of the chamber's topics [s]."""


@dataclass(frozen=True)
class Profile:
    """A thermal test profile. `run_steps` is one run; `steps` the whole, with all orientations."""

    name: str
    limits: Limits
    run_steps: tuple[Step, ...]
    """Steps of one run, cycles unrolled."""
    on_abort: OnAbort = OnAbort()
    ambient_c: float = 20.0
    """At or above, the chamber may be opened [°C]."""
    orientations: tuple[str, ...] = ()
    """Signed axes that point up, one run each; empty: one run, orientation not stated."""
    record: Record = Record()
    description: str = ''
    norm: str = ''
    text: str = field(default='', compare=False, repr=False)
    """The YAML text the profile was read from."""
    source: str = field(default='', compare=False)

    @property
    def steps(self) -> tuple[Step, ...]:
        """All steps: every orientation's run, an operator step before each further one."""
        from chamber_profile.profile.unroll import campaign_steps

        return campaign_steps(self)

    @property
    def sha256(self) -> str:
        """Hash of the file's text: names exactly this profile in journal and recording."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def start_c(self) -> float:
        """Temperature the first step goes to [°C]."""
        return self.run_steps[0].target_c


def profile_names() -> list[str]:
    """Return the names of the profiles that ship."""
    return sorted(path.stem for path in PROFILES.glob('*.yaml'))


def load_profile(name_or_path: str | Path) -> Profile:
    """Return the profile of a file, or the one that ships under a name.

    Raises ProfileError with everything that is wrong at once, each with its place in the file.
    """
    path = Path(name_or_path)
    shipped = PROFILES / f'{name_or_path}.yaml'
    if path.parent == Path() and not path.suffix and shipped.is_file():
        path = shipped
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or str(error)
        raise ProfileError(
            f'profile {str(name_or_path)!r}: {reason}; a file, or one of '
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
    from chamber_profile.profile.unroll import signed_axis, unrolled_steps

    record = dict(content.get('record', {}))
    if 'topics' in record:
        record['topics'] = tuple(record['topics'])
    return Profile(
        name=content['name'],
        limits=Limits(**_floats(Limits, content['limits'])),
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
