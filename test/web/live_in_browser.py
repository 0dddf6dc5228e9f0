# SPDX-License-Identifier: Apache-2.0
"""The live view shows what is published: values, attitude, phase; and what falls silent."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from threading import Event, Thread

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Imu, Temperature
from std_msgs.msg import String

from .conftest import ROOT

DEVICE = '/dut7'
PERIOD_S = 0.02
ERROR = 0.004
"""What the compensated angular velocity differs by [rad/s]."""
ROLL_DEG = {'complementary': 30.0, 'ahrs': 31.0}


class Board(Node):
    """A board that rests at 25 °C, its compensation, two filters and a chamber."""

    def __init__(self, context: Context) -> None:
        super().__init__('board', namespace=DEVICE, context=context, use_global_arguments=False)
        names = ('imu/data_raw', 'imu_compensated/data_raw')
        names += tuple(f'imu/data_{name}' for name in ROLL_DEG)
        self.imus = {name: self.create_publisher(Imu, name, 50) for name in names}
        self.die = self.create_publisher(Temperature, 'imu/temperature', 50)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        phase = self.create_publisher(String, '/chamber/phase', latched)
        phase.publish(String(data='dwell_hot 2'))

    def send(self) -> None:
        """Publish one sample of everything."""
        stamp = self.get_clock().now().to_msg()
        for name, publisher in self.imus.items():
            message = Imu()
            message.header.stamp = stamp
            message.angular_velocity.x = 0.01 if name.endswith('imu/data_raw') else 0.01 - ERROR
            message.linear_acceleration.z = 9.81
            roll = ROLL_DEG.get(name.removeprefix('imu/data_'))
            message.orientation_covariance[0] = -1.0 if roll is None else 1e-4
            if roll is not None:
                message.orientation.x = math.sin(math.radians(roll) / 2)
                message.orientation.w = math.cos(math.radians(roll) / 2)
            publisher.publish(message)
        die = Temperature(temperature=25.0)
        die.header.stamp = stamp
        self.die.publish(die)


@pytest.fixture
def silence(monkeypatch: pytest.MonkeyPatch, ros_domains: Iterator[int]) -> Iterator[Event]:
    """Publish until the event is set, in a domain that the server inherits."""
    domain = next(ros_domains)
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    context, quiet, ended = Context(), Event(), Event()
    rclpy.init(args=[], context=context, domain_id=domain)
    board = Board(context)

    def publish() -> None:
        while not ended.wait(PERIOD_S):
            if not quiet.is_set():
                board.send()

    thread = Thread(target=publish)
    thread.start()
    yield quiet
    ended.set()
    thread.join()
    board.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.fixture
def ros_node(silence: Event) -> Iterator[Node]:
    """Another node in the board's domain."""
    context = Context()
    rclpy.init(args=[], context=context, domain_id=int(os.environ['ROS_DOMAIN_ID']))
    node = Node('another', context=context, use_global_arguments=False)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.mark.long
def test_controls_wait_until_a_board_is_heard(serve, watch, silence):
    silence.set()
    page = watch(serve('--root', ROOT / 'bags').address + '?live=1').page
    page.get_by_text('Waiting for the first samples').wait_for()
    zero = page.get_by_role('button', name='Take zero')
    assert zero.is_disabled()
    silence.clear()
    page.locator('.live-tiles').get_by_text('25.00 °C').wait_for()
    assert zero.is_enabled()


def test_what_is_published_is_shown_until_it_falls_silent(serve, watch, silence):
    server = serve('--root', ROOT / 'bags')
    watched = watch(server.address + '?live=1')
    page = watched.page
    tiles = page.locator('.live-tiles')
    tiles.get_by_text('hot dwell, cycle 2').wait_for()
    tiles.get_by_text('25.00 °C').wait_for()
    assert page.get_by_role('combobox', name='live device').input_value() == DEVICE

    row = page.locator('.live-table tr', has_text='gyroscope x')
    row.get_by_text(f'{math.degrees(ERROR):.4f}').wait_for()
    assert f'{math.degrees(0.01):.4f}' in row.inner_text()
    for name, roll in (('complementary', 30), ('AHRS', 31)):
        page.locator(f'svg[aria-label^="{name}: roll {roll}.0°"]').wait_for()
    page.get_by_text('Between them: 1.00°').wait_for()
    page.locator('.live .js-plotly-plot .main-svg').nth(3).wait_for()

    page.get_by_role('combobox', name='sensor').click()
    page.get_by_role('option', name='accelerometer').click()
    page.locator('.live .ytitle', has_text='m/s²').first.wait_for()
    page.get_by_role('button', name='Take zero').click()
    silence.set()
    silent = page.get_by_text(re.compile('^Silent: .*/dut7/imu/data_raw'))
    silent.wait_for()
    silence.clear()
    silent.wait_for(state='hidden')
    assert server.alive
    watched.check()


@pytest.mark.long
def test_two_publishers_on_one_topic_are_a_warning(serve, watch, silence, ros_node):
    ros_node.create_publisher(Imu, f'{DEVICE}/imu/data_ahrs', 50)
    server = serve('--root', ROOT / 'bags')
    watched = watch(server.address + '?live=1')
    page = watched.page
    page.get_by_text(re.compile(r'^Warning: /dut7/imu/data_ahrs has 2 publishers')).wait_for()
    page.get_by_text('Between them: unknown').wait_for()
    assert page.get_by_text('Between them: 0.00').count() == 0
    watched.check()


def test_a_middleware_that_is_not_installed_is_said_on_the_page(serve, watch, monkeypatch):
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_absent_cpp')
    server = serve('--root', ROOT / 'bags')
    page = watch(server.address + '?live=1').page
    message = page.get_by_text('ROS 2 does not start')
    message.wait_for()
    assert 'rmw_absent_cpp' in message.inner_text()
    page.get_by_role('button', name='Case', exact=True).click()
    page.get_by_text('Nothing to look at yet').first.wait_for()
    assert server.alive
