# SPDX-License-Identifier: Apache-2.0
"""Thermal compensation from bag to numbers, without ROS: golden coefficients and errors."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from thermal_comp.comparison.compare import compare
from thermal_comp.compensation.recording import compensate
from thermal_comp.compensation.stream import Compensator
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from thermal_comp.model.values import ThermalModel

from imu_recording import ImuRecording, read_bag

COMMAND = 'python -m imu_workbench fit bags/dut2_x bags/dut2_y bags/dut2_z -o model.yaml'


@pytest.fixture(scope='module')
def recordings(bags: Path) -> list[ImuRecording]:
    return [read_bag(bags / f'dut2_{axis}') for axis in 'xyz']


@pytest.fixture(scope='module')
def model(recordings: list[ImuRecording]) -> ThermalModel:
    return fit([EFFECTS['bias_temperature']()], recordings)


def test_fit_and_comparison_give_the_golden_numbers(
    recordings: list[ImuRecording], model: ThermalModel, golden: Callable[..., None]
) -> None:
    values = {}
    for sensor, part in compare(model, recordings).sensors.items():
        values[f'{sensor} slope'] = model.sensors[sensor].coefficients[0][0]
        values[f'{sensor} measured_rms'] = part.measured_rms
        values[f'{sensor} held_out_rms'] = part.held_out_rms
    golden('thermal_comp_dut2', values, COMMAND, rtol=2e-3)


def test_the_stream_of_a_bag_equals_the_bag(
    recordings: list[ImuRecording], model: ThermalModel
) -> None:
    part = recordings[0].rows(slice(6000, 8000))
    batch = compensate(part, model)
    compensator = Compensator(model)
    for i, stamp in enumerate(part.stamp.tolist()):
        compensator.on_temperature(stamp, float(part.temperature[i]))
        rate, force = compensator.on_imu(
            stamp,
            tuple(part.angular_velocity[i].tolist()),
            tuple(part.linear_acceleration[i].tolist()),
        )
        np.testing.assert_allclose(rate.value, batch.angular_velocity[i], rtol=0, atol=1e-12)
        np.testing.assert_allclose(force.value, batch.linear_acceleration[i], rtol=0, atol=1e-12)


def test_compensation_removes_the_thermal_error_of_another_run(
    recordings: list[ImuRecording],
) -> None:
    elsewhere = fit([EFFECTS['bias_temperature']()], recordings[:2])
    raw = recordings[2]
    done = compensate(raw, elsewhere)
    for name in ('angular_velocity', 'linear_acceleration', 'magnetic_field'):
        before, after = (block_means(getattr(r, name)) for r in (raw, done))
        assert (after.std(axis=0) < 0.5 * before.std(axis=0)).all()


def block_means(values: np.ndarray) -> np.ndarray:
    """Means of fifty samples."""
    whole = len(values) // 50 * 50
    return np.nanmean(values[:whole].reshape(-1, 50, 3), axis=1)


def test_replay_needs_no_ros() -> None:
    code = (
        "import sys; sys.modules['rclpy'] = None\n"
        'import thermal_comp.compensation.stream, thermal_comp.comparison.compare\n'
        'import thermal_comp.fitting.pooling\n'
        "assert not [m for m in sys.modules if m.startswith(('launch', 'sensor_msgs'))]\n"
    )
    subprocess.run([sys.executable, '-c', code], check=True)
