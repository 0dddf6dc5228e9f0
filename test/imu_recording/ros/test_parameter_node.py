# SPDX-License-Identifier: Apache-2.0
"""Parameters of a node: what may change when, and of what type they are."""

from __future__ import annotations

from typing import Any

import pytest
from doubler import make
from imu_recording.ros.parameter import ParameterError
from rclpy.parameter import Parameter
from std_msgs.msg import Float64


def test_dynamic_parameters_change_while_active_and_others_do_not(ros: Any) -> None:
    node, sent = make()
    node.autostart()
    changed = node.set_parameters([Parameter('factor', value=5)])[0]
    fixed = node.set_parameters([Parameter('topic', value='other')])[0]
    wrong = node.set_parameters([Parameter('factor', value=50.0)])[0]
    assert changed.successful
    assert not fixed.successful
    assert 'topic takes effect at configuration' in fixed.reason
    assert node.set_parameters([Parameter('topic', value='out')])[0].successful, 'as it is'
    assert not wrong.successful
    assert '50' in wrong.reason
    node.inputs['in'](Float64(data=2.0))
    assert sent[-1][1].data == 10.0
    node.destroy_node()


def test_a_list_of_numbers_may_be_of_integers(ros: Any) -> None:
    node, _ = make(weights=[1, 0])
    assert node.autostart()
    assert node.config.weights == [1.0, 0.0]
    node.destroy_node()
    with pytest.raises(ParameterError, match="weights is 'heavy', expected a list"):
        make(weights='heavy')
    with pytest.raises(ParameterError, match='factor is -1, expected 0 … 10'):
        make(factor=-1)


def test_a_double_stays_a_double(ros: Any) -> None:
    node, _ = make(factor=3)
    assert type(node.get_parameter('factor').value) is float
    assert node.set_parameters([Parameter('factor', value=4)])[0].successful
    assert node.get_parameter('factor').type_ == Parameter.Type.DOUBLE
    assert not node.set_parameters([Parameter('factor', value='much')])[0].successful
    assert not node.describe_parameter('factor').dynamic_typing
    assert node.set_parameters([Parameter('weights', value=[2, 1])])[0].successful
    assert node.get_parameter('weights').type_ == Parameter.Type.DOUBLE_ARRAY
    node.destroy_node()
