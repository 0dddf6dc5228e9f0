# SPDX-License-Identifier: Apache-2.0
"""Check the YAML text of a profile: every mistake at once, each with its line."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import yaml
from imu_recording.user_error import UserError

Place: TypeAlias = tuple[str | int, ...]


@dataclass(frozen=True)
class LocatedText:
    """A YAML document: its content and the line of each value."""

    content: Any
    lines: dict[Place, int]
    """Line (1 …) of the value, or of the key where there is one, by path from the root."""
    problems: tuple[tuple[int, str], ...] = ()
    """Line and message of duplicate keys, which YAML itself accepts."""

    def line(self, place: Place) -> int:
        """Return the line of a place, or of the nearest place above it that has one."""
        while place and place not in self.lines:
            place = place[:-1]
        return self.lines.get(place, 1)


class LocatedTextError(UserError):
    """Text that is not YAML; the message begins with the line."""


def parse_located(text: str) -> LocatedText:
    """Return the content of a YAML text with the lines of its values (plain types only)."""
    loader = yaml.SafeLoader(text)
    try:
        root = loader.get_single_node()
        if root is None:
            raise LocatedTextError('line 1: the file is empty')
        lines: dict[Place, int] = {}
        problems: list[tuple[int, str]] = []
        content = _plain(loader, root, (), lines, problems)
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, 'problem_mark', None)
        line = mark.line + 1 if mark else 1
        what = getattr(error, 'problem', None) or str(error)
        raise LocatedTextError(f'line {line}: not valid YAML: {what}') from error
    finally:
        loader.dispose()
    return LocatedText(content, lines, tuple(problems))


def _plain(
    loader: yaml.SafeLoader,
    node: yaml.Node,
    place: Place,
    lines: dict[Place, int],
    problems: list[tuple[int, str]],
) -> Any:
    lines.setdefault(place, node.start_mark.line + 1)
    if isinstance(node, yaml.SequenceNode):
        return [
            _plain(loader, item, (*place, i), lines, problems) for i, item in enumerate(node.value)
        ]
    if not isinstance(node, yaml.MappingNode):
        try:
            return loader.construct_object(node)
        except ValueError as error:  # no such date
            fault = str(error)
            raise yaml.constructor.ConstructorError(None, None, fault, node.start_mark) from None
    content: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = str(getattr(key_node, 'value', '?'))
        line = key_node.start_mark.line + 1
        if key in content:
            first = lines[(*place, key)]
            problems.append((line, f'key {key!r} is given twice (first on line {first})'))
            continue
        lines[(*place, key)] = line
        content[key] = _plain(loader, value_node, (*place, key), lines, problems)
    return content


SCHEMA_FILE = Path(__file__).parent / 'profile.schema.json'


class ProfileError(UserError):
    """A profile that cannot be run; one mistake per line, each with its place in the file."""


@cache
def profile_schema() -> dict[str, Any]:
    """Return the JSON Schema of profile files."""
    schema: dict[str, Any] = json.loads(SCHEMA_FILE.read_text(encoding='utf-8'))
    return schema


def checked_content(text: str, source: str) -> dict[str, Any]:
    """Return the content of a profile's YAML text; raise ProfileError with every mistake."""
    try:
        located = parse_located(text)
    except LocatedTextError as error:
        raise ProfileError(f'{source}: {error}') from error
    problems = content_problems(located)
    if problems:
        raise ProfileError(';\n'.join(f'{source}:{line}: {what}' for line, what in problems))
    content: dict[str, Any] = located.content
    return content


def content_problems(located: LocatedText) -> list[tuple[int, str]]:
    """Return line and message of every mistake, in the order of the file."""
    found = list(located.problems)
    found += [(located.line(place), what) for place, what in _schema_problems(located.content)]
    found += [
        (located.line(place), f'{_dotted(place)} is {value}, expected a finite number')
        for place, value in _not_finite(located.content, ())
    ]
    if isinstance(located.content, dict):
        found += [
            (located.line(place), what) for place, what in _consistency_problems(located.content)
        ]
    return sorted(set(found))


def _schema_problems(content: Any) -> Iterator[tuple[Place, str]]:
    from jsonschema import Draft202012Validator

    for error in Draft202012Validator(profile_schema()).iter_errors(content):
        place: Place = tuple(error.absolute_path)
        if error.validator == 'additionalProperties':
            known = sorted(error.schema['properties'])
            for key in sorted(set(error.instance) - set(known)):
                yield (
                    (*place, key),
                    f'{_dotted((*place, key))}: unknown key; known: {_list(known)}',
                )
        elif error.validator == 'anyOf':
            yield from _cycle_key_problems(place, error.instance)
        else:
            yield place, f'{_dotted(place)}: {error.message}'


def _cycle_key_problems(place: Place, cycles: Any) -> Iterator[tuple[Place, str]]:
    for index, cycle in enumerate(cycles if isinstance(cycles, list) else [cycles]):
        at = (*place, index) if isinstance(cycles, list) else place
        if not isinstance(cycle, dict):
            yield at, f'{_dotted(at)}: expected from, to and count'
            continue
        for key in sorted(set(cycle) - {'from', 'to', 'count'}):
            yield (*at, key), f'{_dotted((*at, key))}: unknown key; known: count, from, to'
        for key in sorted({'from', 'to', 'count'} - set(cycle)):
            yield at, f'{_dotted(at)}: {key!r} is a required property'
        count = cycle.get('count', 1)
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= 10000:
            yield (*at, 'count'), f'{_dotted((*at, "count"))} is {count!r}, expected 1 … 10000'


def _not_finite(value: Any, place: Place) -> Iterator[tuple[Place, float]]:
    if isinstance(value, float) and not math.isfinite(value):
        yield place, value
    items: Any = ()
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value)
    for key, item in items:
        yield from _not_finite(item, (*place, key))


def _consistency_problems(content: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Yield mistakes a schema cannot find: limits, order of steps, names."""
    limits = content.get('limits')
    limits = limits if isinstance(limits, dict) else {}
    low, high = _number(limits, 'air_min_c', -math.inf), _number(limits, 'air_max_c', math.inf)
    fastest = _number(limits, 'rate_max_c_per_min', math.inf)
    if low >= high:
        yield ('limits', 'air_min_c'), f'limits: air_min_c {low:g} is not below air_max_c {high:g}'
    device_low = _number(limits, 'device_min_c', -40.0)
    device_high = _number(limits, 'device_max_c', 85.0)
    if device_low >= device_high:
        yield (
            ('limits', 'device_min_c'),
            f'limits: device_min_c {device_low:g} is not below device_max_c {device_high:g}',
        )
    low, high = max(low, device_low), min(high, device_high)
    steps = content.get('steps')
    named: list[tuple[int, Mapping[str, Any]]] = [
        (i, step)
        for i, step in enumerate(steps if isinstance(steps, list) else [])
        if isinstance(step, dict)
    ]
    for place, entry in [
        *((('steps', i), step) for i, step in named),
        (('on_abort',), content.get('on_abort')),
    ]:
        if isinstance(entry, dict):
            yield from _limit_problems(place, entry, low, high, fastest)
    ambient = _number(content, 'ambient_c', 20.0)
    if named and not low <= ambient <= high:
        yield (
            ('ambient_c',),
            (f'ambient_c {ambient:g} is outside the limits {low:g} … {high:g} °C'),
        )
    yield from _step_problems(named)
    yield from _cycle_range_problems(content.get('cycles'), [step.get('id') for _, step in named])


def _limit_problems(
    place: Place, entry: Mapping[str, Any], low: float, high: float, fastest: float
) -> Iterator[tuple[Place, str]]:
    target = _number(entry, 'target_c', math.nan)
    if target < low or target > high:
        yield (
            (*place, 'target_c'),
            f'{_dotted(place)}: target_c {target:g} is outside the limits {low:g} … {high:g} °C',
        )
    rate = _number(entry, 'rate_c_per_min', math.nan)
    if rate > fastest:
        yield (
            (*place, 'rate_c_per_min'),
            f'{_dotted(place)}: rate_c_per_min {rate:g} is above the limit {fastest:g} °C/min',
        )


def _step_problems(named: list[tuple[int, Mapping[str, Any]]]) -> Iterator[tuple[Place, str]]:
    seen: dict[Any, int] = {}
    at: float | None = None
    for index, step in named:
        place: Place = ('steps', index)
        identity = step.get('id')
        if identity in seen:
            first = seen[identity]
            yield (
                (*place, 'id'),
                f'{_dotted(place)}: id {identity!r} is already that of steps[{first}]',
            )
        seen.setdefault(identity, index)
        kind = step.get('kind')
        target = _number(step, 'target_c', math.nan)
        known = not math.isnan(target)
        if index == 0 and kind in ('ramp', 'dwell', 'operator'):
            what = f'{_dotted(place)}: the first step must be a precondition, not {kind}'
            yield (*place, 'kind'), what
        if kind == 'ramp' and known and target == at:
            yield (
                (*place, 'target_c'),
                f'{_dotted(place)}: ramp to {target:g} °C, the temperature of the step before',
            )
        if kind == 'dwell' and known and at is not None and target != at:
            yield (
                (*place, 'target_c'),
                f'{_dotted(place)}: dwell at {target:g} °C after {at:g} °C: put a ramp between',
            )
        at = target if known else at


def _cycle_range_problems(cycles: Any, ids: list[Any]) -> Iterator[tuple[Place, str]]:
    if cycles is None:
        return
    behind = -1
    for index, cycle in enumerate(cycles if isinstance(cycles, list) else [cycles]):
        place: Place = ('cycles', index) if isinstance(cycles, list) else ('cycles',)
        if not isinstance(cycle, dict):
            continue
        ends = []
        for key in ('from', 'to'):
            name = cycle.get(key)
            if name in ids:
                ends.append(ids.index(name))
            elif isinstance(name, str):
                yield (
                    (*place, key),
                    f'{_dotted((*place, key))}: no step {name!r}; there are {_list(ids)}',
                )
        if len(ends) == 2:
            if ends[0] > ends[1]:
                yield place, f'{_dotted(place)}: {cycle["from"]!r} comes after {cycle["to"]!r}'
            elif ends[0] <= behind:
                yield place, f'{_dotted(place)}: overlaps the cycle before it'
            behind = max(behind, ends[1])


def _number(entry: Mapping[str, Any], key: str, default: float) -> float:
    value = entry.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return default
    return float(value)


def _dotted(place: Place) -> str:
    text = ''
    for part in place:
        text += f'[{part}]' if isinstance(part, int) else f'.{part}' if text else part
    return text or 'profile'


def _list(names: list[Any]) -> str:
    return ', '.join(str(name) for name in names)
