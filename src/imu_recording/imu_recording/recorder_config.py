# SPDX-License-Identifier: Apache-2.0
"""Parameters of the recorder node."""

from __future__ import annotations

from dataclasses import dataclass

from imu_recording.node_config import NodeConfig
from imu_recording.parameter import parameter


@dataclass(frozen=True)
class RecorderConfig(NodeConfig):
    """Parameters of the recorder."""

    output: str = parameter('', 'Folder of the bag; empty: recordings/<UTC>')
    topics: list[str] = parameter(  # noqa: RUF009
        [], 'Topics to record, * and ? allowed; empty: those of the profile, or all'
    )
    split: str = parameter(
        '', "When to begin a file: 'phase', 'none', '500 MB', both; empty: as the profile says"
    )
    device: str = parameter('', 'Serial number or name of the device, for the metadata')
    run: str = parameter('', 'Name of the run, for the metadata; empty: as chamber/run says')
    up_axis: str = parameter('', 'Sensor axis that points up, +x … -z; empty: as chamber/run says')
    profile: str = parameter('', 'Name or file of the thermal profile, for the metadata')
    metadata: list[str] = parameter([], "Further metadata, 'key=value'")  # noqa: RUF009
