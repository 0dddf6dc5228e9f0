# SPDX-License-Identifier: Apache-2.0
"""What the process that workers are forked from has imported and loaded: every task, all kernels.

Its import is the preparation; whatever is missing here each worker would load anew.
"""

from __future__ import annotations

from contextlib import suppress

from thermal_comp.precompile import precompile

from imu_workbench.web.case import next_experiment, preview, tasks

__all__ = ['next_experiment', 'preview', 'tasks']

with suppress(OSError):  # it writes small bags and reads them; where it cannot, workers load
    precompile()
