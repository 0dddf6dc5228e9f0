# SPDX-License-Identifier: Apache-2.0
"""orient: what a compensation does to the attitude, the same in every world frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from thermal_comp.effects import EFFECTS
from thermal_comp.model.file import save_model
from thermal_comp.model.values import NoiseModel, SensorModel, ThermalModel

from imu_recording import ImuRecording, write_bag

from .asking import Answer

RATE = 1e-3
"""Error of the gyroscope about the vertical at 30 °C [rad/s]: 3.4° in a minute."""


@pytest.fixture(scope='module')
def warm(run: Callable[..., ImuRecording], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute at rest and 30 °C, its attitude known; the gyroscope off by RATE about z."""
    folder = tmp_path_factory.mktemp('orient')
    rows = run(up='z', rate_hz=50.0, cycles=1).rows(slice(0, 3000))
    count = len(rows)
    still = replace(
        rows,
        angular_velocity=np.tile([0.0, 0.0, RATE], (count, 1)),
        linear_acceleration=np.tile([0.0, 0.0, 9.81], (count, 1)),
        magnetic_field=np.tile([0.0, 2e-5, -4e-5], (count, 1)),
        temperature=np.full(count, 30.0),
        reference_orientation=np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)),
    )
    write_bag(still, folder / 'bag')
    for name, slope in (('right', RATE / 10.0), ('none', 0.0)):
        line = SensorModel(
            (EFFECTS['bias_temperature'](),),
            (np.array([[0.0, 0.0, slope]]),),
            np.zeros((3, 3)),
            NoiseModel(np.full(3, 1e-5), np.array([100.0]), np.zeros((1, 3))),
            temperature_range=(0.0, 50.0),
        )
        save_model(ThermalModel('dut1', {'gyroscope': line}), folder / f'{name}.yaml')
    return folder


def errors(answer: Answer, warm: Path, model: str, *more: str) -> dict[str, Any]:
    """Return what the answer says of each kind of data, six axes, one filter."""
    chosen = ['--filter', 'complementary', '--preset', 'paper', '--six-axis', *more]
    code, content, _ = answer('orient', warm / 'bag', '--model', warm / f'{model}.yaml', *chosen)
    assert code == 0
    (bag,) = content['bags']
    assert {cost['filter'] for cost in bag['costs']} == {'complementary'}
    return {cost['data']: cost for cost in bag['costs']}


@pytest.mark.parametrize('world_frame', ['enu', 'ned', 'nwu'])
def test_a_heading_that_runs_away_is_charged_to_the_gyroscope(
    world_frame: str, warm: Path, answer: Answer
) -> None:
    """It turns by rate × time: rms over a minute rate · 60 s / √3, in every frame."""
    found = errors(answer, warm, 'right', '--world-frame', world_frame)
    runaway = np.degrees(RATE * 60.0 / np.sqrt(3.0))
    for data in ('compensated', 'gyroscope compensated'):
        assert found[data]['moved']['heading'] == pytest.approx(runaway, rel=1e-3)
    for data in ('accelerometer compensated', 'magnetometer compensated'):
        assert found[data]['moved']['heading'] == pytest.approx(0.0, abs=1e-6)
    if world_frame == 'enu':  # six axes start east, where the reference is
        assert found['raw']['rms']['total'] == pytest.approx(runaway, rel=1e-3)
        assert found['compensated']['rms']['total'] == pytest.approx(0.0, abs=1e-6)


def test_a_model_of_nothing_moves_nothing(warm: Path, answer: Answer) -> None:
    found = errors(answer, warm, 'none')
    assert all(cost['moved']['total'] == 0.0 for cost in found.values())
    assert all(cost['rms'] == found['raw']['rms'] for cost in found.values())


def test_ten_minutes_are_said_first(warm: Path, answer: Answer) -> None:
    _, _, text = answer('orient', warm / 'bag', '--model', warm / 'right.yaml', '--six-axis')
    assert f'turns the attitude by {np.degrees(600.0 * RATE):.1f}°' in text
