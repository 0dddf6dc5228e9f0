# SPDX-License-Identifier: Apache-2.0
"""A campaign of two orientations on real nodes: a bag for each, what the profile wants in it."""

import time
from pathlib import Path

import pytest
import rclpy
import yaml
from imu_recording.bags.messages import bag_topics, read_messages
from laboratory import DOMAIN, Laboratory
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

pytestmark = pytest.mark.end_to_end

CAMPAIGN = """\
schema: 1
name: campaign
orientations: [x, -z]
limits: {air_min_c: 15, air_max_c: 30, rate_max_c_per_min: 3}
stabilise: {source: air, band_c: 0.6, timeout_s: 900}
record: {topics: [chamber/temperature, chamber/phase], split: none}
steps:
  - {id: precondition, kind: precondition, target_c: 22, rate_c_per_min: 3, dwell_s: 120}
  - {id: heat, kind: ramp, target_c: 25, rate_c_per_min: 3}
  - {id: final, kind: final, target_c: 25, rate_c_per_min: 3, dwell_s: 60}
on_abort: {target_c: 24, rate_c_per_min: 3}
"""


def call(service: str) -> Trigger.Response:
    """Call a service of the laboratory's nodes."""
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = rclpy.create_node('operator', context=context)
    executor = SingleThreadedExecutor(context=context)
    try:
        client = node.create_client(Trigger, service)
        assert client.wait_for_service(60.0)
        answer = client.call_async(Trigger.Request())
        executor.add_node(node)
        executor.spin_until_future_complete(answer, 60.0)
        return answer.result()
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)


def confirmed(service: str) -> None:
    """Confirm as soon as the chamber asks for it."""
    end = time.monotonic() + 60.0
    while not call(service).success:
        assert time.monotonic() < end


def custom_data(metadata: Path) -> dict[str, str]:
    """Return what a bag says about itself."""
    return yaml.safe_load(metadata.read_text())['rosbag2_bagfile_information']['custom_data']


def test_each_orientation_gets_its_bag_and_an_operator_turns_the_devices(laboratory) -> None:
    lab: Laboratory = laboratory(profile=CAMPAIGN)
    recorder = lab.start('imu_recording.recorder.node', output=lab.folder / 'rec')
    lab.until(recorder, 'recording to')
    node = lab.node()
    lab.until(recorder, 'x\n')
    lab.until(node, 'confirm, Turn the devices so that -z points up')
    confirmed('/chamber_profile/confirm')
    lab.until(recorder, '-z\n')
    assert lab.finish(node) == 0
    lab.until(recorder, 'waiting for the next run')
    recorder.terminate()
    assert lab.finish(recorder) == 0
    bags = {bag.parent: custom_data(bag) for bag in lab.folder.glob('**/metadata.yaml')}
    runs = {data['up_axis']: folder for folder, data in bags.items() if data}
    assert set(runs) == {'+x', '-z'}
    for axis, folder in runs.items():
        assert folder.name.endswith(axis.lstrip('+'))
        assert bags[folder]['profile'] == 'campaign'
        assert set(bag_topics(folder)) == {'/chamber/temperature', '/chamber/phase'}
        assert len(read_messages(folder, ['/chamber/temperature'])) > 5
        assert len(list(folder.glob('*.mcap'))) == 1
