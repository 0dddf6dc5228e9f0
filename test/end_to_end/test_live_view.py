# SPDX-License-Identifier: Apache-2.0
"""Driver → compensation → filters and a chamber, as processes, into the model of the live page."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from time import monotonic
from typing import Any

import numpy as np
import pytest
from imu_recording.ros.diagnostics import node_of
from imu_workbench.web.live import readings as view
from imu_workbench.web.live.listener import Listener, Watch
from imu_workbench.web.live.topics import namespaces

pytestmark = pytest.mark.end_to_end

NAMESPACE = '/robot1'
PATIENCE_S = 240.0
NODES = ('imu_driver', 'thermal_comp', 'complementary_filter', 'ahrs_filter')


@pytest.fixture
def listener(processes: Any) -> Iterator[Listener]:
    """Listen where the processes talk."""
    listening = Listener(domain_id=int(processes.environment['ROS_DOMAIN_ID']))
    yield listening
    listening.close()
    assert not listening.listening


def start_drop_in(processes: Any, model: Path) -> None:
    """Start a chain in a namespace whose compensated stream takes the raw one's name."""
    place = ('--ros-args', '-r', f'__ns:={NAMESPACE}')
    uncompensated = ('-r', 'imu/data_raw:=imu/uncompensated')
    processes.start(
        'imu_driver', 'imu_driver_node', *place, *uncompensated,
        '-p', 'transport:=simulated://dut1', '-p', 'output_data_rate:=50',
    )  # fmt: skip
    processes.start(
        'thermal_comp', 'thermal_comp_node', *place, *uncompensated,
        '-r', 'imu_compensated/data_raw:=imu/data_raw', '-p', f'model:={model}',
    )  # fmt: skip
    for name in ('complementary', 'ahrs'):
        processes.start(
            'orientation_filters', f'{name}_filter_node', *place, '-r', f'imu/data:={name}'
        )
    processes.start(
        'chamber_profile', 'chamber_profile_node', '--ros-args', '-p', 'profile:=short_20min',
        '-p', 'start:=true', '-p', 'require_imu:=false', '-p', 'time_scale:=10.0',
        '-p', f'run_directory:={processes.folder}/run',
    )  # fmt: skip


def until(condition: Callable[[], Any], processes: Any, what: Callable[[], Any]) -> None:
    """Wait until the condition holds; say what there is where it never does."""
    pause, deadline = Event(), monotonic() + PATIENCE_S
    while not condition():
        assert monotonic() < deadline, (what(), processes.logs())
        pause.wait(0.1)


def all_is_heard(watch: Watch) -> bool:
    """Tell whether every role has spoken for a while, and every node of itself."""
    state = watch.state
    with state.lock:
        streams = ('raw', 'difference', 'difference_field', 'complementary', 'ahrs')
        enough = all(len(state.tracks[n].recent.since(0).stamp) >= 50 for n in streams)
        single = all(state.tracks[n].newest >= 0 for n in ('temperature', 'air', 'setpoint'))
        said = {node_of(name).rpartition('/')[2] for name in state.statuses}
        left = math.isfinite(view.chamber_times(state.statuses)[1])
    return enough and single and left and bool(state.phase) and said >= set(NODES)


@pytest.mark.long
def test_a_remapped_chain_in_a_namespace_is_shown_whole(
    processes: Any, listener: Listener, dut1_model: Path
) -> None:
    start_drop_in(processes, dut1_model)
    until(lambda: NAMESPACE in namespaces(listener.topics), processes, lambda: listener.topics)
    watch = listener.watch(NAMESPACE)
    until(lambda: all_is_heard(watch), processes, lambda: (watch.topics, watch.state.phase))
    assert watch.topics['raw'] == f'{NAMESPACE}/imu/uncompensated'
    assert watch.topics['compensated'] == f'{NAMESPACE}/imu/data_raw'
    assert watch.topics['ahrs'] == f'{NAMESPACE}/ahrs'
    state = watch.state
    with state.lock:
        modelled = state.tracks['difference'].recent.since(0).values
        force = view.reading(state, 'accelerometer', 0).compensated
        attitudes = [view.attitude(state, name) for name in ('complementary', 'ahrs')]
        phase_left, run_left = view.chamber_times(state.statuses)
        air = view.value_of(state, 'air')
    assert np.isfinite(modelled).all()
    assert (np.abs(modelled).max(0) > 0).all()
    assert np.abs(modelled[:, :3]).max() < np.radians(5.0)
    roll = math.atan2(force[1], force[2])
    for attitude in attitudes:
        assert attitude is not None
        assert attitude.euler[0] == pytest.approx(roll, abs=math.radians(5.0))
    assert 0.0 <= phase_left <= run_left <= 3600.0
    assert -30.0 < air < 80.0
    assert state.unreadable == 0
    assert listener.watch(NAMESPACE) is watch
