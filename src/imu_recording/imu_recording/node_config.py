# SPDX-License-Identifier: Apache-2.0
"""Parameters all nodes have."""

from __future__ import annotations

from dataclasses import dataclass

from imu_recording.parameter import parameter


@dataclass(frozen=True)
class NodeConfig:
    """Parameters all nodes have; each node's dataclass extends this one."""

    autostart: bool = parameter(True, 'Configure and activate by itself at start')
    qos_depth: int = parameter(500, 'Queue depth of publishers and subscriptions', bounds=(1, 1e5))
