# SPDX-License-Identifier: Apache-2.0
"""Figures of the live view, and its tables: units, colours, extremes, markup as text."""

import json
import math
import re

import numpy as np
import pytest
from imu_recording.bags.decoding.cdr import encode_messages
from imu_recording.logging_contract import IMU, TEMPERATURE
from imu_recording.recording import SECOND_NS
from imu_workbench.report.figures.palette import COLOURS, painted
from imu_workbench.web.live import figures
from imu_workbench.web.live import tables as text
from imu_workbench.web.live.state import LiveState, NodeStatus

START = 1_800_000_000 * SECOND_NS
RATE = np.array([0.02, -0.01, 0.005])
SPIKE = 1.5


@pytest.fixture(scope='module')
def state() -> LiveState:
    """Half a minute at 200 Hz with one spike; 25 °C."""
    state = LiveState(lambda: 0.0)
    stamp = START + (np.arange(6000) * SECOND_NS // 200)
    noise = np.random.default_rng(3).normal(0.0, 1e-3, (6000, 3))
    noise[4321, 0] = SPIKE
    force = np.broadcast_to([0.0, 0.0, 9.8], (6000, 3))
    for role, bias in (('raw', 0.004), ('compensated', 0.0)):
        for row in encode_messages(IMU, stamp, 'imu', (RATE + bias + noise, force)):
            state.put(role, row.tobytes())
    warm = np.full((30, 1), 25.0)
    for row in encode_messages(TEMPERATURE, stamp[::200], 'imu', (warm,)):
        state.put('temperature', row.tobytes())
    state.absorb()
    return state


def all_figures(state: LiveState, window_s: float) -> list[dict]:
    return [
        figures.measured_figure(state, 'gyroscope', window_s),
        figures.residual_figure(state, 'gyroscope', window_s, 0),
        figures.temperature_figure(state, window_s),
        figures.euler_figure(state, window_s),
    ]


@pytest.mark.parametrize('window_s', [20.0, 120.0, 3600.0, 43_200.0])
def test_every_axis_has_a_unit_and_few_points(state: LiveState, window_s: float) -> None:
    for figure in all_figures(state, window_s):
        axes = {k: v for k, v in figure['layout'].items() if re.match(r'[xy]axis', k)}
        for axis in axes.values():
            assert re.search(r'\[.+\]$', axis['title']['text'])
        for trace in figure['data']:
            assert len(trace['x']) == len(trace['y']) <= figures.LINE_POINTS
            assert all(map(math.isfinite, trace['y']))
            assert f'{trace["yaxis"][:1]}axis{trace["yaxis"][1:]}' in axes
        assert json.loads(json.dumps(figure)) == figure


def test_a_spike_survives_the_screen(state: LiveState) -> None:
    figure = figures.measured_figure(state, 'gyroscope', 20.0)
    spiked = next(t for t in figure['data'] if t['name'] == 'x')
    assert max(spiked['y']) == pytest.approx(math.degrees(SPIKE + RATE[0]), rel=1e-3)


def test_what_compensation_takes_away_is_drawn_in_degrees(state: LiveState) -> None:
    figure = figures.residual_figure(state, 'gyroscope', 20.0, 0)
    taken = [trace for trace in figure['data'] if trace['yaxis'] == 'y']
    for trace in taken:
        np.testing.assert_allclose(trace['y'], math.degrees(0.004), rtol=1e-4)


def test_the_time_axis_is_as_long_as_what_was_heard(state: LiveState) -> None:
    layout = figures.measured_figure(state, 'gyroscope', 3600.0)['layout']
    assert layout['xaxis']['title']['text'] == 'time before now [min]'
    assert -0.5 < layout['xaxis']['range'][0] < -0.4


@pytest.mark.parametrize('theme', sorted(COLOURS))
def test_every_colour_is_of_the_palette(state: LiveState, theme: str) -> None:
    for figure in all_figures(state, 20.0):
        assert '"@' not in json.dumps(painted(figure, theme))


def test_the_table_says_what_the_second_was(state: LiveState) -> None:
    table = text.values_table(state, 0)
    row = re.search(r'gyroscope x \[°/s\](.+?)</tr>', table)
    assert row
    cells = [float(c.replace('−', '-')) for c in re.findall(r'<td>([^<]+)</td>', row[1])]
    assert cells[2] == pytest.approx(math.degrees(0.004), abs=1e-4)
    assert cells[0] - cells[1] == pytest.approx(cells[2], abs=2e-4)
    assert cells[4] == pytest.approx(math.degrees(1e-3), rel=0.2)
    missing = re.search(r'magnetometer z \[µT\](.+?)</tr>', table)
    assert missing
    assert set(re.findall(r'<td>([^<]+)</td>', missing[1])) == {'–'}


def test_what_nodes_say_is_text_not_markup() -> None:
    status = NodeStatus('<b>x</b>', 1, '<script>', {'<i>': '<u>'}, 0.0)
    assert '<i>' not in text.details(status)
    assert text.headline(status, 1.0) == ('warning', '<b>x</b>: <script>')
    assert text.headline(status, 60.0)[0] == 'stale'


def test_a_topic_that_fell_silent_is_told(state: LiveState) -> None:
    topics = {'raw': '/imu/data_raw', 'ahrs': '/imu/data_ahrs'}
    assert text.silent_roles(state, topics) == []
    late = LiveState(lambda: 10.0)
    late.tracks['raw'].received = 0.0
    assert text.silent_roles(late, topics) == ['/imu/data_raw']
    assert 'silent for 10 s' in text.topics_table(late, topics)
