# SPDX-License-Identifier: Apache-2.0
"""The reference logger node in-process: what it publishes of the bytes it is given."""

from chamber_profile.reference.node import ReferenceLoggerNode


def test_the_node_publishes_each_column_on_its_topic(ros) -> None:
    sent = []
    node = ReferenceLoggerNode(
        capture=lambda topic, message: sent.append((topic, message)), now=lambda: 5_000_000_007
    )
    assert node.autostart()
    node.on_bytes(b'0.0,20.01,20.02,21.1,21.2,')
    node.on_bytes(b'21.3\r\n')
    assert {topic: message.temperature for topic, message in sent} == {
        'chamber/temperature': 20.01,
        'chamber/temperature_2': 20.02,
        'dut1/chamber/device_temperature': 21.1,
        'dut2/chamber/device_temperature': 21.2,
        'dut3/chamber/device_temperature': 21.3,
    }
    assert {message.header.stamp.nanosec for _, message in sent} == {7}
    assert node.diagnostics()[0] == 0
    node.on_bytes(b'1.0,20.01,OPEN,21.1,21.2,21.3\r\n')
    level, line, _ = node.diagnostics()
    assert level == 1
    assert 'chamber/temperature_2' in line
    node.destroy_node()
