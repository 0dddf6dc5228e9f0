# SPDX-License-Identifier: Apache-2.0
"""The attitude as a transform; tf2_msgs is imported only when asked for."""

from __future__ import annotations

from typing import Any

from imu_recording.messages import ImuSample, fill_quaternion, fill_stamp
from imu_recording.user_error import UserError

from orientation_filters.live_filter import Estimate


def transform_class() -> Any:
    """Return tf2_msgs/TFMessage; raise ValueError where the package is absent."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError as error:
        raise UserError('publish_tf needs the package tf2_msgs, which is absent') from error
    return TFMessage


def transform_message(world_frame_id: str, sample: ImuSample, estimate: Estimate) -> Any:
    """Return a TFMessage with the rotation world → body."""
    from geometry_msgs.msg import TransformStamped

    transform = TransformStamped(child_frame_id=sample.frame_id)
    transform.header.frame_id = world_frame_id
    fill_stamp(transform.header.stamp, sample.stamp)
    fill_quaternion(transform.transform.rotation, estimate.orientation)
    return transform_class()(transforms=[transform])
