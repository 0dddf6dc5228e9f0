# SPDX-License-Identifier: Apache-2.0
"""A YAML file of the user's, checked against a JSON schema of this package."""

from __future__ import annotations

import datetime as dt
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml
from imu_recording.user_error import UserError, did_you_mean, fault_in_yaml


def read_checked(path: Path, schema: str) -> dict[str, Any]:
    """Return the content of a YAML file; raise UserError that names file, field and mistake.

    `schema` is the name of a file in `imu_workbench/report/schemas`.
    """
    from jsonschema import Draft202012Validator

    try:
        content = json_like(yaml.safe_load(path.read_text('utf-8')))
    except UnicodeDecodeError as error:
        raise UserError(f'{path}: is no text in UTF-8') from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UserError(f'{path}: {fault_in_yaml(error)}') from error
    text = files('imu_workbench').joinpath('report', 'schemas', schema).read_text('utf-8')
    errors = sorted(Draft202012Validator(json.loads(text)).iter_errors(content), key=str)
    if errors:
        raise UserError(f'{path}: {_mistake(errors[0])}')
    found: dict[str, Any] = content
    return found


def json_like(value: Any) -> Any:
    """Return the value with YAML's dates as text, as JSON has them."""
    if isinstance(value, dict):
        return {str(key): json_like(item) for key, item in value.items()}
    if isinstance(value, list):
        return [json_like(item) for item in value]
    return value.isoformat() if isinstance(value, dt.date) else value


def _mistake(error: Any) -> str:
    place = '.'.join(map(str, error.absolute_path)) or 'the file'
    if error.validator == 'additionalProperties' and error.validator_value is False:
        known = sorted(error.schema['properties'])
        key = next(iter(sorted(set(error.instance) - set(known))))
        return f'{place}: unknown key {key!r}{did_you_mean(key, known)}; known: {", ".join(known)}'
    return f'{place}: {error.message}'
