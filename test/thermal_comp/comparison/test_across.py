# SPDX-License-Identifier: Apache-2.0
"""The model of one device on the runs of another."""

from __future__ import annotations

from dataclasses import replace

import pytest
from imu_workbench.simulate.campaign import Logging, simulate_campaign
from thermal_comp.comparison.across import compare_across
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.model.values import ModelError


def test_a_foreign_model_fits_a_twin_and_no_stranger() -> None:
    logging = Logging(0.5, mean=True)
    poses = ('+x', '+z')
    first = simulate_campaign('short_20min', 'dut1', logging, seed=1, orientations=poses)
    again = simulate_campaign('short_20min', 'dut1', logging, seed=2, orientations=poses)
    twin = [replace(recording, device='twin') for recording in again]
    other = simulate_campaign('short_20min', 'dut2', logging, seed=1, orientations=poses)
    runs = prepare([*first, *twin, *other])
    pairs = compare_across([BiasTemperature()], runs)
    assert len(pairs) == 6 * 3
    magnetometers = {(p.model, p.device): p for p in pairs if p.sensor == 'magnetometer'}
    close, far = magnetometers['dut1', 'twin'], magnetometers['dut2', 'twin']
    assert close.foreign < 1.1 * close.own < 0.2 * close.raw
    assert close.compatible >= 2
    assert far.foreign > 1.5 * far.raw  # the slopes have opposite signs
    assert not far.good_enough
    with pytest.raises(ModelError, match='needs the runs of two'):
        compare_across([BiasTemperature()], runs[:2])
