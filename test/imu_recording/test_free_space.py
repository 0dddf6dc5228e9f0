# SPDX-License-Identifier: Apache-2.0
"""The room for a folder that does not exist yet is that of the nearest one that does."""

import shutil
from pathlib import Path

from imu_recording.free_space import free_bytes, standing_folder


def test_the_nearest_folder_that_exists(tmp_path: Path) -> None:
    assert standing_folder(tmp_path / 'runs' / 'today') == tmp_path
    assert abs(free_bytes(tmp_path / 'runs') - shutil.disk_usage(tmp_path).free) < 1 << 30
