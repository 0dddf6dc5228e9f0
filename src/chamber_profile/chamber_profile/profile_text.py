# SPDX-License-Identifier: Apache-2.0
"""YAML with places: plain content, and the line every value stands on; duplicate keys found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import yaml
from imu_recording.user_error import UserError

Place: TypeAlias = tuple[str | int, ...]


@dataclass(frozen=True)
class LocatedText:
    """A YAML document: its content and where each value stands."""

    content: Any
    lines: dict[Place, int]
    """Line (1 …) of the value, or of the key where there is one, by path from the root."""
    problems: tuple[tuple[int, str], ...] = ()
    """Line and message of what YAML itself does not refuse: duplicate keys, keys of odd type."""

    def line(self, place: Place) -> int:
        """Return the line of the nearest thing known at or above the place."""
        while place and place not in self.lines:
            place = place[:-1]
        return self.lines.get(place, 1)


class LocatedTextError(UserError):
    """Text that is no YAML; the message begins with the line."""


def parse_located(text: str) -> LocatedText:
    """Return the content of a YAML text with the lines of its values (safe types only)."""
    loader = yaml.SafeLoader(text)
    try:
        root = loader.get_single_node()
        if root is None:
            raise LocatedTextError('line 1: the file is empty')
        lines: dict[Place, int] = {}
        problems: list[tuple[int, str]] = []
        content = _plain(loader, root, (), lines, problems)
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        line = mark.line + 1 if mark else 1
        what = getattr(error, 'problem', None) or str(error)
        raise LocatedTextError(f'line {line}: no valid YAML: {what}') from error
    finally:
        loader.dispose()  # type: ignore[no-untyped-call]
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
        return loader.construct_object(node)
    content: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = str(getattr(key_node, 'value', '?'))
        line = key_node.start_mark.line + 1
        if key in content:
            first = lines[(*place, key)]
            problems.append((line, f'key {key!r} stands twice (first on line {first})'))
            continue
        lines[(*place, key)] = line
        content[key] = _plain(loader, value_node, (*place, key), lines, problems)
    return content
