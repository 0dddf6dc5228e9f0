# SPDX-License-Identifier: Apache-2.0
"""What `ros2 param describe` says of a parameter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor

from imu_recording.parameter import listed


def parameter_descriptor(metadata: Mapping[str, Any]) -> ParameterDescriptor:
    """Return the descriptor of a field declared by `parameter`, from its metadata."""
    unit = f' [{metadata["unit"]}]' if metadata['unit'] else ''
    choices = f'; one of {listed(metadata["choices"])}' if metadata['choices'] else ''
    descriptor = ParameterDescriptor(  # dynamic: what is wrong is told here, not by rcl
        description=f'{metadata["description"]}{unit}{choices}', dynamic_typing=True
    )
    if metadata['bounds']:
        low, high = metadata['bounds']
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high))
        ]
        descriptor.additional_constraints = f'{low:g} … {high:g}'
    return descriptor
