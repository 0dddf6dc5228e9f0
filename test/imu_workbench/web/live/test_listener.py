# SPDX-License-Identifier: Apache-2.0
"""Whoever ends a process that listens is not told that it was aborted."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

OPENED = 'from imu_workbench.web.live.listener import shared_listener; shared_listener()'


def test_a_process_that_ends_right_after_the_live_view_was_opened_is_not_aborted(
    ros_domains: Iterator[int],
) -> None:
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(next(ros_domains))}
    ended = subprocess.run(
        [sys.executable, '-c', OPENED],
        env=environment, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, '')
