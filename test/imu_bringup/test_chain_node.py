# SPDX-License-Identifier: Apache-2.0
"""The chain in one process: the bytes of separate nodes, and nothing made that nobody wants."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_bringup.chain_node import ImuChainNode
from imu_driver.node import ImuDriverNode
from imu_recording.recorder.node import RecorderNode
from imu_recording.ros.exchange import SampleOutput
from imu_recording.ros.messages import TemperatureSample
from orientation_filters.node import AhrsFilterNode, ComplementaryFilterNode
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, MagneticField
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from thermal_comp.model.file import save_model
from thermal_comp.node import ThermalCompNode

from imu_recording import ImuRecording, read_bag, write_bag

DEADLINE = 60.0
TOPICS = {
    'imu/data_raw': Imu,
    'imu/mag': MagneticField,
    'imu_compensated/data_raw': Imu,
    'imu_compensated/mag': MagneticField,
    'imu/data_complementary': Imu,
    'imu/data_ahrs': Imu,
}
WITHIN = ('-r', 'imu/data_raw:=imu_compensated/data_raw', '-r', 'imu/mag:=imu_compensated/mag')
FILTERS = (('complementary', ComplementaryFilterNode), ('ahrs', AhrsFilterNode))
COUNT = 250
FIRST = 1_700_000_000_000_000_000
PERIOD = 10_000_000
DIE_C = 31.0


@pytest.fixture(scope='module')
def model(bags: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('model') / 'dut1.yaml'
    save_model(fit((EFFECTS['bias_temperature'](),), [read_bag(bags / 'dut1_x')]), path)
    return path


@pytest.fixture(scope='module')
def source(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A turning device at 100 Hz, its magnetometer at 50 Hz; played ten times as fast.

    Its die has one temperature: over DDS a sample may overtake the temperature of its stamp.
    """
    rng = np.random.default_rng(3)
    field = rng.normal((2e-5, 0.0, -4e-5), 1e-7, (COUNT, 3))
    field[1::2] = np.nan
    recording = ImuRecording(
        stamp=FIRST + PERIOD * np.arange(COUNT),
        angular_velocity=rng.normal((0.0, 0.1, 0.3), 0.02, (COUNT, 3)),
        linear_acceleration=rng.normal((0.0, 0.0, 9.8), 0.05, (COUNT, 3)),
        magnetic_field=field,
        temperature=np.full(COUNT, DIE_C),
        frame_id='imu_link',
    )
    folder = tmp_path_factory.mktemp('source') / 'bag'
    write_bag(recording, folder)
    return f'bag://{folder}?rate=10'


class Listener:
    """Serialised messages of all topics below a namespace, in order."""

    def __init__(self, ros: Any, namespace: str) -> None:
        self.node = ros.create_node('listener', namespace=namespace)
        self.heard: dict[str, list[bytes]] = {topic: [] for topic in TOPICS}
        for topic, kind in TOPICS.items():
            take = self.heard[topic].append
            self.node.create_subscription(kind, topic, take, QoSProfile(depth=1000), raw=True)

    def complete(self) -> bool:
        return all(
            len(heard) == (COUNT // 2 if topic.endswith('mag') else COUNT)
            for topic, heard in self.heard.items()
        )


def run_until(nodes: list[Any], done: Callable[[], bool]) -> None:
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    give_up = time.monotonic() + DEADLINE
    while not done() and time.monotonic() < give_up:
        executor.spin_once(timeout_sec=0.05)
    for node in nodes:
        executor.remove_node(node)
    assert done()


def subscribed(node: Any, *topics: str) -> Callable[[], bool]:
    return lambda: all(node.count_subscribers(topic) for topic in topics)


def heard_of_separate_nodes(ros: Any, source: str, model: Path) -> dict[str, list[bytes]]:
    listener = Listener(ros, '/apart')
    place: dict[str, Any] = {'namespace': '/apart'}
    compensation = ThermalCompNode(parameters={'model': str(model)}, **place)
    nodes = [
        compensation,
        *(
            kind(cli_args=['--ros-args', *WITHIN, '-r', f'imu/data:=imu/data_{name}'], **place)
            for name, kind in FILTERS
        ),
        ImuDriverNode(parameters={'transport': source}, **place),
    ]
    assert all(node.autostart() for node in nodes)
    # Over DDS the first sample may come before the first temperature.
    compensation.on_temperature(TemperatureSample(FIRST - PERIOD, DIE_C))
    run_until([listener.node, *nodes], listener.complete)
    for node in nodes:
        node.end()
        node.destroy_node()
    listener.node.destroy_node()
    return listener.heard


def test_bytes_equal_those_of_separate_nodes(ros: Any, source: str, model: Path) -> None:
    listener = Listener(ros, '/within')
    chain = ImuChainNode(
        namespace='/within',
        parameters={'transport': source, 'model': str(model), 'filter': 'both'},
    )
    assert chain.autostart()
    assert [stage.state for stage in chain.hosted] == ['active'] * 4
    run_until([listener.node, chain, *chain.hosted], listener.complete)
    assert chain.hosted[1].count_subscribers('imu/data_raw') == 1, 'the listener, no stage'
    chain.destroy_node()
    listener.node.destroy_node()
    apart = heard_of_separate_nodes(ros, source, model)
    for topic in TOPICS:
        assert listener.heard[topic] == apart[topic], topic


def test_no_message_is_made_for_nobody_and_the_bag_holds_all(
    ros: Any, source: str, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[SampleOutput] = []
    unpatched = SampleOutput.send

    def send(output: SampleOutput, sample: Any) -> None:
        convert = output._to_bytes
        output._to_bytes = lambda item: (made.append(output), convert(item))[1]
        unpatched(output, sample)
        output._to_bytes = convert

    monkeypatch.setattr(SampleOutput, 'send', send)
    given = {'transport': source, 'model': str(model), 'filter': 'ahrs'}
    quiet = ImuChainNode(namespace='/quiet', parameters=given)
    assert quiet.autostart()
    driver, _, ahrs = quiet.hosted
    run_until([quiet, *quiet.hosted], lambda: driver.driver.has_ended)
    quiet.end()
    assert ahrs.diagnostics()[2]['filter'] == 'ahrs'
    assert ahrs.filter._statistics.counts['samples'] >= COUNT - 1
    assert not made
    quiet.destroy_node()

    bag = tmp_path / 'bag'
    recording = ImuChainNode(namespace='/kept', parameters={**given, 'record': str(bag)})
    recorder = recording.hosted[-1]
    assert isinstance(recorder, RecorderNode)
    recording.trigger_configure()
    for stage in recording.hosted[1:]:
        stage.trigger_activate()
    taken = ('/kept/imu/data_raw', '/kept/imu/mag', '/kept/imu/data')

    def found() -> bool:
        recorder.discover()
        return all(topic in recorder.inputs for topic in taken)

    run_until([recording, *recording.hosted], found)
    recording.trigger_activate()
    driver = recording.hosted[0]
    run_until([recording, *recording.hosted], lambda: driver.driver.has_ended)
    recording.destroy_node()
    back = read_bag(bag, namespace='/kept')
    assert len(back) == COUNT
    original = read_bag(source.removeprefix('bag://').partition('?')[0])
    assert np.array_equal(back.angular_velocity, original.angular_velocity)
    assert made


def test_a_stage_that_refuses_is_named_and_nothing_stays_configured(
    ros: Any, source: str, tmp_path: Path
) -> None:
    parameters = {'transport': source, 'model': str(tmp_path / 'none.yaml')}
    chain = ImuChainNode(namespace='/refused', parameters=parameters)
    assert not chain.autostart()
    assert chain.refused.startswith('thermal_comp: ')
    assert 'none.yaml' in chain.refused
    assert {stage.state for stage in chain.hosted} == {'unconfigured'}
    chain.destroy_node()


@pytest.mark.parametrize('of', ['bag', 'board'])
def test_not_one_sample_of_another_device_is_compensated(
    ros: Any, bags: Path, model: Path, of: str
) -> None:
    transport = f'bag://{bags}/dut2_x?rate=0' if of == 'bag' else 'simulated://dut2'
    parameters = {'transport': transport, 'model': str(model), 'filter': 'none'}
    chain = ImuChainNode(namespace=f'/other_{of}', parameters=parameters)
    driver, compensation = chain.hosted
    pairs: list[tuple[Any, Any]] = []
    passed = compensation._exchange.topic(f'/other_{of}/imu_compensated/data_raw')
    measured = compensation._exchange.topic(f'/other_{of}/imu/data_raw')
    raw: list[Any] = []
    measured.listen(raw.append, serialised=False)  # hears a sample before the stage does
    passed.listen(lambda sample: pairs.append((raw[-1], sample)), serialised=False)
    assert chain.autostart()
    run_until([chain, *chain.hosted], lambda: len(pairs) >= COUNT)
    assert all(given == passed_on for given, passed_on in pairs)
    level, line, _ = compensation.diagnostics()
    assert level == 2
    assert f'the data of {driver.driver.device}' in line
    chain.destroy_node()


def test_a_stage_may_leave_and_come_back(ros: Any, source: str) -> None:
    chain = ImuChainNode(namespace='/leaving', parameters={'transport': source})
    driver, ahrs = chain.hosted
    assert chain.autostart()
    ahrs.trigger_deactivate()
    assert chain.diagnostics()[:2] == (1, 'ahrs_filter is inactive')
    ahrs.trigger_cleanup()
    driver.trigger_deactivate()
    assert ahrs.autostart()
    driver.trigger_activate()
    counts = ahrs.filter._statistics.counts
    run_until([chain, *chain.hosted], lambda: counts['samples'] >= COUNT - 1)
    assert chain.diagnostics()[0] == 0
    chain.destroy_node()


def test_another_drivers_topics_can_be_the_source(ros: Any) -> None:
    chain = ImuChainNode(namespace='/foreign', parameters={'transport': 'topic'})
    assert [stage.get_name() for stage in chain.hosted] == ['ahrs_filter']
    assert chain.autostart()
    assert chain.hosted[0].count_subscribers('imu/data_raw') == 1
    chain.destroy_node()


def test_a_refused_stage_is_named_and_set_right(ros: Any, source: str) -> None:
    chain = ImuChainNode(namespace='/wrong', parameters={'transport': 'foo://x'})
    assert not chain.autostart()
    assert chain.refuser == '/wrong/imu_driver'
    assert "imu_driver: transport 'foo://x'" in chain.refused
    (stage,) = [node for node in chain.hosted if node.get_name() == 'imu_driver']
    stage.set_parameters([Parameter('transport', value=source)])
    assert chain.autostart()
    chain.destroy_node()


def test_what_runs_is_not_changed_in_silence(ros: Any, source: str) -> None:
    chain = ImuChainNode(namespace='/fixed', parameters={'transport': source})
    chain.set_parameters([Parameter('filter', value='both')])
    assert not chain.autostart()
    assert chain.refused.startswith('filter takes effect when the process starts')
    chain.destroy_node()


def test_a_node_starts_without_the_libraries_of_the_analysis() -> None:
    heavy = ['scipy.linalg', 'scipy.optimize', 'scipy.signal', 'scipy.stats']
    code = f'import sys, imu_bringup.chain_node; print([m for m in {heavy} if m in sys.modules])'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'
