# SPDX-License-Identifier: Apache-2.0
"""Refusal of deeply nested YAML, which overflows the stack of the loader that is written in C."""

from __future__ import annotations

import yaml

YAML_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
"""The safe loader, written in C where PyYAML was built with it."""
DEEPEST_NESTING = 200
"""Deepest nesting of lists and mappings; no file of this workspace comes near."""


def refuse_deep_yaml(text: str) -> None:
    """Raise yaml.YAMLError where a text is broken or nested deeper than DEEPEST_NESTING.

    The parser's events are counted, which needs no recursion.
    """
    depth = 0
    for event in yaml.parse(text, Loader=YAML_LOADER):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST_NESTING:
            raise yaml.YAMLError(f'lists and mappings are nested more than {DEEPEST_NESTING} deep')
