# SPDX-License-Identifier: Apache-2.0
"""A bag through the node's callbacks is the bag compensated as a whole."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_workbench.replay import replay
from thermal_comp.compensation.recording import compensate
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.file import load_model, save_model

from imu_recording import read_bag, write_bag

HISTORY = ('bias_temperature', 'thermal_lag', 'thermal_hysteresis', 'thermal_gradient')


@pytest.mark.parametrize(
    ('names', 'tolerance'),
    [pytest.param(('bias_temperature',), 1e-12, marks=pytest.mark.long), (HISTORY, 1e-9)],
)
def test_node_and_batch_agree(
    bags: Path, tmp_path: Path, names: tuple[str, ...], tolerance: float
) -> None:
    whole = read_bag(bags / 'dut2_x')
    effects = [EFFECTS[name]() for name in names]
    save_model(fit_prepared(effects, prepare([whole]), refine=False), tmp_path / 'model.yaml')
    write_bag(whole.rows(slice(4000, 5500)), tmp_path / 'part')
    batch = compensate(read_bag(tmp_path / 'part'), load_model(tmp_path / 'model.yaml'))
    sent = replay(tmp_path / 'part', 'thermal_comp', {'model': str(tmp_path / 'model.yaml')})
    imu = [item.message for item in sent if item.topic == '/imu_compensated/data_raw']
    field = [item.message for item in sent if item.topic == '/imu_compensated/mag']
    assert len(imu) == len(field) == 1500
    for name, messages in (('linear_acceleration', imu), ('angular_velocity', imu)):
        vectors = [getattr(message, name) for message in messages]
        found = np.array([(v.x, v.y, v.z) for v in vectors])
        np.testing.assert_allclose(found, getattr(batch, name), rtol=0, atol=tolerance)
    found = np.array([(m.magnetic_field.x, m.magnetic_field.y, m.magnetic_field.z) for m in field])
    np.testing.assert_allclose(found, batch.magnetic_field, rtol=0, atol=1e-15)


def test_node_and_batch_pass_on_what_a_silent_temperature_leaves(
    bags: Path, tmp_path: Path
) -> None:
    part = read_bag(bags / 'dut2_x').rows(slice(4000, 4400))
    measured, temperature = part.stamp.copy(), part.temperature.copy()
    measured[100:200], temperature[100:200] = measured[99], temperature[99]
    write_bag(replace(part, temperature=temperature, temperature_stamp=measured), tmp_path / 'b')
    model = fit_prepared(
        [EFFECTS['bias_temperature']()], prepare([read_bag(bags / 'dut2_x')]), refine=False
    )
    save_model(model, tmp_path / 'model.yaml')
    batch = compensate(read_bag(tmp_path / 'b'), load_model(tmp_path / 'model.yaml'))
    sent = replay(tmp_path / 'b', 'thermal_comp', {'model': str(tmp_path / 'model.yaml')})
    rates = [s.message.angular_velocity for s in sent if s.topic == '/imu_compensated/data_raw']
    found = np.array([(v.x, v.y, v.z) for v in rates])
    np.testing.assert_allclose(found, batch.angular_velocity, rtol=0, atol=1e-12)
    passed_on = (found == part.angular_velocity).all(axis=1)
    step = (part.stamp[1] - part.stamp[0]) * 1e-9
    assert np.flatnonzero(passed_on).tolist() == list(range(100 + int(10.0 / step), 200))
