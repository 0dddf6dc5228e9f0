# SPDX-License-Identifier: Apache-2.0
"""What worker processes need, imported once in the process they are forked from."""

from imu_workbench.web.case import tasks

__all__ = ['tasks']
