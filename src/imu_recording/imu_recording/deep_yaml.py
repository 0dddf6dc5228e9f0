# SPDX-License-Identifier: Apache-2.0
"""YAML nested without end, which overflows the stack of the loader that is written in C."""

from __future__ import annotations

import yaml

DEEPEST = 200
"""Lists and mappings within each other; no file here comes near."""


def refuse_deep_yaml(text: str) -> None:
    """Raise yaml.YAMLError where lists and mappings are nested more than DEEPEST deep, or broken.

    The parser's events are counted, which takes no stack.
    """
    depth = 0
    for event in yaml.parse(text, Loader=getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise yaml.YAMLError(f'lists and mappings are nested more than {DEEPEST} deep')
