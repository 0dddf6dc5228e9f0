# SPDX-License-Identifier: Apache-2.0
"""Parameters of the filter nodes: the filter's, and what is sent and how they listen."""

from __future__ import annotations

from dataclasses import dataclass

from imu_recording.node_config import NodeConfig
from imu_recording.parameter import parameter

from orientation_filters.ahrs_parameters import AhrsParameters
from orientation_filters.complementary_parameters import ComplementaryParameters


@dataclass(frozen=True)
class OutputConfig(NodeConfig):
    """What the nodes send, and how they listen."""

    publish_euler: bool = parameter(True, 'Publish roll, pitch, yaw [rad] on ~/euler')
    publish_tf: bool = parameter(False, 'Publish world → body on /tf (needs tf2_msgs)')
    world_frame_id: str = parameter('world', 'Name of the parent frame on /tf')
    body_frame_id: str = parameter('', 'Frame of the output; empty: as the input')
    raw_subscription: bool = parameter(
        False, 'Take messages undecoded: half the load, for rates above 500 Hz'
    )


@dataclass(frozen=True)
class ComplementaryConfig(ComplementaryParameters, OutputConfig):
    """Parameters of complementary_filter."""


@dataclass(frozen=True)
class AhrsConfig(AhrsParameters, OutputConfig):
    """Parameters of ahrs_filter."""
