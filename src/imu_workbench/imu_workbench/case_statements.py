# SPDX-License-Identifier: Apache-2.0
"""What a laboratory stated once for a case: laboratory.yaml and limits.yaml in its folder."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import yaml
from imu_recording.user_error import UserError

from imu_workbench.report.laboratory import Laboratory, read_laboratory
from imu_workbench.report.limits import CoefficientLimits, read_limits

LABORATORY, LIMITS = 'laboratory.yaml', 'limits.yaml'


def keep_statement(folder: Path, name: str, content: bytes) -> str:
    """Keep a file of a laboratory or of limits in a case's folder; return its name there.

    Raises UserError that says what is wrong with it, and keeps the former file then.
    """
    with TemporaryDirectory() as temporary:
        given = Path(temporary) / Path(name).name
        given.write_bytes(content)
        try:
            kept = LIMITS if _holds_limits(given) else LABORATORY
            (read_limits if kept == LIMITS else read_laboratory)(given)
        except UserError as error:
            raise UserError(str(error).replace(f'{temporary}/', '')) from None
    (folder / kept).write_bytes(content)
    return kept


def statements_of(folder: Path) -> tuple[Laboratory | None, CoefficientLimits | None]:
    """Return what the files in a case's folder state, None for a file that is not there."""
    laboratory, limits = folder / LABORATORY, folder / LIMITS
    return (
        read_laboratory(laboratory) if laboratory.exists() else None,
        read_limits(limits) if limits.exists() else None,
    )


def statement_files(folder: Path) -> list[Path]:
    """Return which of the two files there are."""
    return [path for name in (LABORATORY, LIMITS) if (path := folder / name).exists()]


def _holds_limits(path: Path) -> bool:
    try:
        content = yaml.safe_load(path.read_text('utf-8'))
    except (yaml.YAMLError, ValueError, RecursionError):
        return False  # the reader says what is wrong
    return isinstance(content, dict) and 'limits' in content
