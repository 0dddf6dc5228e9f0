# SPDX-License-Identifier: Apache-2.0
"""The layouts name topics, fields and diagnostics that the nodes really publish."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from chamber_profile.node import ChamberProfileNode
from imu_driver.node import ImuDriverNode
from imu_recording.ros.message_cdr import message_class
from imu_workbench.isolated_context import quiet_context
from orientation_filters.node import AhrsFilterNode, ComplementaryFilterNode
from sensor_msgs.msg import Imu
from thermal_comp.node import ThermalCompNode

LAYOUTS = Path(__file__).resolve().parents[2] / 'src' / 'imu_bringup' / 'layouts'
FLOATS = ('double', 'float')


@pytest.fixture(scope='module')
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[dict[str, str], dict]]:
    """Topic → type of all nodes with their usual names, and what they say in diagnostics."""
    folder: Path = tmp_path_factory.mktemp('run')
    with quiet_context() as context:
        options: dict[str, Any] = {'context': context, 'use_global_arguments': False}
        nodes = [
            ImuDriverNode(parameters={'transport': 'simulated://dut1'}, **options),
            ThermalCompNode(**options),
            ChamberProfileNode(
                parameters={
                    'profile': 'short_20min', 'chamber': 'simulated', 'start': True,
                    'require_imu': False, 'run_directory': str(folder / 'run'),
                },
                **options,
            ),
        ]  # fmt: skip
        for name, kind in (('complementary', ComplementaryFilterNode), ('ahrs', AhrsFilterNode)):
            remap = ['--ros-args', '-r', f'imu/data:=imu/data_{name}']
            nodes.append(kind(cli_args=remap, **options))
        topics: dict[str, str] = {}
        for node in nodes:
            assert node.trigger_configure()
            place = (node.get_name(), node.get_namespace())
            for topic, types in node.get_publisher_names_and_types_by_node(*place):
                topics[topic] = types[0]
        chamber = nodes[2]
        chamber.command('start')
        chamber.advance()
        values = {
            f'{node.hardware}/{node.get_name()}: {task}': status[2]
            for node in nodes
            for task, status in node.tasks().items()
        }
        yield topics, values
        chamber.run.conductor.stop_at_once()
        chamber.run.conductor.close()
        for node in nodes:
            node.destroy_node()


def field_type(message_type: str, names: list[str]) -> str:
    """Return the type of a field, following the names into nested messages."""
    for name in names:
        message_type = message_class(full(message_type)).get_fields_and_field_types()[name]
    return message_type


def full(message_type: str) -> str:
    """Return 'package/msg/Name' of 'package/Name'."""
    package, *_, name = message_type.split('/')
    return f'{package}/msg/{name}'


def topic_of(series: str, topics: dict[str, str]) -> tuple[str, list[str]]:
    """Return the topic a PlotJuggler series is of, and the names of the fields behind it."""
    found = [topic for topic in topics if series.startswith(f'{topic}/')]
    assert found, f'{series}: nobody publishes it'
    topic = max(found, key=len)
    return topic, series.removeprefix(f'{topic}/').split('/')


def check_series(series: str, topics: dict[str, str], values: dict[str, dict]) -> None:
    """Check one series: a number in a message, or a number among a node's diagnostics."""
    if series.startswith('/diagnostics/'):
        hardware, task, key = series.removeprefix('/diagnostics/').split('/', 2)
        told = values[f'{hardware}/{task}']
        float(str(told[key]))
        assert not told.get('device'), 'the device would stand in the name of the series'
        return
    topic, names = topic_of(series, topics)
    assert field_type(topics[topic], names) in FLOATS, series


def test_every_plotjuggler_curve_is_published(plotjuggler: ET.Element, system: Any) -> None:
    equations = {e.get('name'): e for e in plotjuggler.iterfind('customMathEquations/snippet')}
    names = [curve.get('name') for curve in plotjuggler.iter('curve')]
    assert len(names) > 40
    for name in names:
        if name in equations:
            sources = [equations[name].findtext('linked_source')]
            sources += [part.text for part in equations[name].find('additional_sources')]
            for source in sources:
                check_series(source, *system)
        else:
            check_series(name, *system)
    assert set(equations) <= set(names)


def test_plotjuggler_subscribes_to_what_it_plots(plotjuggler: ET.Element, system: Any) -> None:
    topics, _ = system
    chosen = plotjuggler.find("Plugins/plugin[@ID='ROS2 Topic Subscriber']/selected_topics")
    selected = {topic.get('name') for topic in chosen}
    assert chosen.get('value').split(';') == [topic.get('name') for topic in chosen]
    assert selected <= set(topics)
    plotted = {
        topic_of(curve.get('name'), topics)[0]
        for curve in plotjuggler.iter('curve')
        if curve.get('name').startswith('/')
    }
    assert plotted <= selected


def test_the_plotjuggler_file_has_the_structure_it_reads(plotjuggler: ET.Element) -> None:
    assert plotjuggler.tag == 'root'
    tabs = plotjuggler.findall('tabbed_widget/Tab')
    assert [tab.get('tab_name') for tab in tabs[:3]] == [
        'Gyroscope', 'Accelerometer', 'Magnetometer',
    ]  # fmt: skip
    for tab in tabs:
        assert int(tab.get('containers')) == len(tab.findall('Container'))
        assert [child.tag for child in tab.find('Container')] == ['DockSplitter']
    for splitter in plotjuggler.iter('DockSplitter'):
        sizes = [float(size) for size in splitter.get('sizes').split(';')]
        assert len(sizes) == int(splitter.get('count')) == len(splitter)
        assert sum(sizes) == pytest.approx(1.0, abs=1e-4)
        assert splitter.get('orientation') in ('-', '|')
    for area in plotjuggler.iter('DockArea'):
        assert [child.tag for child in area] == ['plot']
        assert re.search(r'\[.+\]|Share', area.get('name')), area.get('name')
    streamer = plotjuggler.find('previouslyLoaded_Streamer').get('name')
    assert plotjuggler.find(f"Plugins/plugin[@ID='{streamer}']") is not None


@dataclass
class Transforms:
    """Has the field of tf2_msgs/TFMessage."""

    transforms: list[Any]


def panels_of(layout: Any) -> list[str]:
    """Return the panels of a Foxglove layout tree."""
    if isinstance(layout, str):
        return [layout]
    assert layout['direction'] in ('row', 'column')
    assert 0 < layout['splitPercentage'] < 100
    return panels_of(layout['first']) + panels_of(layout['second'])


def test_every_foxglove_panel_is_placed_once_and_configured(foxglove: dict[str, Any]) -> None:
    config = foxglove['configById']
    placed = panels_of(foxglove['layout'])
    for panel in list(placed):
        for tab in config[panel].get('tabs', []):
            placed += panels_of(tab['layout'])
    assert sorted(placed) == sorted(config)
    kinds = {panel.split('!')[0] for panel in config}
    assert kinds >= {'3D', 'Plot', 'DiagnosticSummary', 'Parameters', 'StateTransitions'}


def test_every_foxglove_path_is_published(foxglove: dict[str, Any], system: Any) -> None:
    topics, values = system
    paths = [path for c in foxglove['configById'].values() for path in c.get('paths', [])]
    assert len(paths) > 25
    for path in paths:
        value = path['value']
        told = re.fullmatch(
            r'/diagnostics\.status\[:\]\{name=="(.+)"\}\.values\[:\]\{key=="(.+)"\}\.value', value
        )
        if told:
            named = {name.partition('/')[2]: said for name, said in values.items()}
            float(str(named[told[1]][told[2]]))
            continue
        topic, *names = value.removesuffix('.@rad2deg').split('.')
        kind = field_type(topics[topic], names)
        assert kind in FLOATS or topic == '/chamber/phase', value
        stamped = 'header' in message_class(topics[topic]).get_fields_and_field_types()
        assert stamped or path['timestampMethod'] == 'receiveTime'
    for config in foxglove['configById'].values():
        assert config.get('topicToRender', '/diagnostics') in topics


def test_the_attitude_panel_shows_the_frames_the_filters_send(
    foxglove: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """tf2_msgs may be absent; which frames are sent does not depend on it."""
    monkeypatch.setattr('orientation_filters.node.transform_class', lambda: Transforms)
    panel = foxglove['configById']['3D!attitude']
    sent: list[Any] = []
    with quiet_context() as context:
        for name, kind in (('complementary', ComplementaryFilterNode), ('ahrs', AhrsFilterNode)):
            node = kind(
                capture=lambda topic, message: sent.append((topic, message)),
                now=lambda: 0,
                parameters={
                    'publish_tf': True, 'body_frame_id': f'imu_{name}', 'use_magnetometer': False,
                },
                context=context,
            )  # fmt: skip
            node.autostart()
            for step in range(5):
                message = Imu()
                message.header.stamp.sec = 1 + step // 100
                message.header.stamp.nanosec = step * 10_000_000
                message.linear_acceleration.z = 9.81
                node.inputs['imu/data_raw'](message)
            node.destroy_node()
    transforms = [m.transforms[0] for topic, m in sent if topic == '/tf']
    frames = {t.child_frame_id for t in transforms} | {t.header.frame_id for t in transforms}
    assert {f'frame:{frame}' for frame in frames} == set(panel['transforms'])
    assert panel['followTf'] in frames


def test_the_aggregator_takes_every_task_once(system: tuple[dict[str, str], dict]) -> None:
    config = yaml.safe_load((LAYOUTS.parent / 'config/diagnostic_aggregator.yaml').read_text())
    groups = [g for g in config['/**']['ros__parameters'].values() if isinstance(g, dict)]
    assert {group['type'] for group in groups} == {'diagnostic_aggregator/GenericAnalyzer'}
    names = [name.partition('/')[2] for name in system[1]]
    names += ['recorder: recording', 'imu_chain: stages', 'reference_logger: port']
    for name in [*names, 'ahrs_filter: input', 'dut1/thermal_comp: input']:
        takers = [g['path'] for g in groups if any(part in name for part in g['contains'])]
        assert len(takers) == 1, name
