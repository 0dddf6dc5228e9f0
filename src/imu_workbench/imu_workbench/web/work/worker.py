# SPDX-License-Identifier: Apache-2.0
"""What the process that workers are forked from has ready: every task, and its kernels.

Its import is the preparation; whatever is missing here each worker would load anew.
"""

from __future__ import annotations

from thermal_comp.precompile import precompile

from imu_workbench.web.case import next_experiment, preview, tasks

__all__ = ['next_experiment', 'preview', 'tasks']

precompile()
