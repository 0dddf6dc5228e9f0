# SPDX-License-Identifier: Apache-2.0
"""What the process that workers are forked from has imported: every task.

Its import is the preparation; whatever is missing here each worker would import anew.
"""

from __future__ import annotations

from imu_workbench.web.case import next_experiment, preview, tasks

__all__ = ['next_experiment', 'preview', 'tasks']
