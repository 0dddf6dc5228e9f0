# SPDX-License-Identifier: Apache-2.0
"""Free space of the disk for a folder that may not exist yet."""

from __future__ import annotations

import shutil
from pathlib import Path


def standing_folder(folder: Path) -> Path:
    """Return the folder, or the nearest one above it that exists."""
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    return place


def free_bytes(folder: Path) -> int:
    """Return the free space where the folder is or will be [bytes]."""
    return shutil.disk_usage(standing_folder(folder)).free
