# SPDX-License-Identifier: Apache-2.0
"""A simulated fleet: its population, its bags, its truth, and the score of a study by it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_driver.simulation.population import OUTLIER_SHARE, draw_fleet_device, draw_lots
from imu_recording.recording import columns_hash
from imu_workbench.__main__ import main
from imu_workbench.simulate.campaign import Logging
from imu_workbench.simulate.fleet import FleetPlan, fleet_truth, score_fleet, simulate_fleet_device

from imu_recording import read_bag

LAG = {'name': 'thermal_lag', 'sensor': 'gyroscope'}
TRUTH: dict[str, Any] = {
    'devices': {
        'a': {'lot': 'A', 'outlier': False, 'effects': [LAG]},
        'b': {'lot': 'A', 'outlier': True, 'effects': []},
        'c': {'lot': 'A', 'outlier': False, 'effects': []},
        'd': {'lot': 'A', 'outlier': False, 'effects': [LAG]},
    },
    'lots': {
        'A': {
            'mean': [0.0] * 9,
            'covariance': [[4.0 * (i == j) for j in range(9)] for i in range(9)],
            'effects': [LAG],
        }
    },
}
STUDY: dict[str, Any] = {
    'odd': [{'device': 'b'}, {'device': 'c'}],
    'populations': [{'lot': 'A', 'sensor': 'gyroscope', 'mean': [0.0, -3.0, 1.0]}],
    'prevalence': [
        {'lot': 'A', 'sensor': 'gyroscope', 'effect': 'thermal_lag', 'named': True, 'share': 0.4}
    ],
}


def test_devices_have_the_mean_and_covariance_of_their_lot() -> None:
    lots = draw_lots(2, seed=5)
    devices = [draw_fleet_device(lots, number, 4000, seed=5) for number in range(4000)]
    for lot in lots:
        ordinary = np.array([d.slopes for d in devices if d.lot == lot.name and not d.outlier])
        deviation = np.sqrt(np.diag(lot.covariance))
        assert np.abs(ordinary.mean(axis=0) - lot.mean).max() < 0.1 * deviation.max()
        found = np.cov(ordinary.T) / np.outer(deviation, deviation)
        wanted = lot.covariance / np.outer(deviation, deviation)
        assert np.abs(found - wanted).max() < 0.12
    odd = sum(bool(device.outlier) for device in devices)
    assert 0.7 * OUTLIER_SHARE < odd / len(devices) < 1.3 * OUTLIER_SHARE


def test_bags_hold_the_devices_and_only_reveal_opens_the_truth(
    tmp_path: Path, capsys: object
) -> None:
    folder = tmp_path / 'fleet'
    verb = ['simulate', 'short_20min', '--fleet', '3', '--lots', '2', '--seed', '3']
    assert main([*verb, '-o', str(folder)]) == 0
    written = read_bag(folder / 'lot=A' / 'A00001' / 'y')
    plan = FleetPlan('short_20min', 3, 2, 3, Logging(0.5, mean=True))
    again = simulate_fleet_device(plan, 0)[1]
    assert (written.device, written.up_axis) == ('A00001', '+y')
    np.testing.assert_allclose(written.angular_velocity, again.angular_velocity)
    assert columns_hash(again) != columns_hash(simulate_fleet_device(plan, 1)[1])
    truth = fleet_truth(folder)
    assert truth is not None
    np.testing.assert_array_equal(truth['devices']['A00001']['slopes'], plan.device(0).slopes)
    assert main(['reveal', str(folder)]) == 0
    assert main([*verb, '-o', str(folder)]) == 2  # nothing is overwritten


def test_outliers_false_alarms_means_and_shares_are_counted() -> None:
    score = score_fleet(STUDY, TRUTH)
    assert (score['outliers'], score['outliers_found']) == (1, 1)
    assert score['false_alarms'] == pytest.approx(1.0 / 3.0)  # of the devices that are ordinary
    assert score['worst_mean_error'] == pytest.approx(1.5)  # in σ of the lot, √4
    assert score['prevalence'] == [
        {'lot': 'A', 'effect': 'thermal_lag', 'sensor': 'gyroscope', 'true': 0.5, 'found': 0.4}
    ]


def test_an_effect_of_another_sensor_is_not_found() -> None:
    elsewhere = [STUDY['prevalence'][0] | {'sensor': 'accelerometer'}]
    score = score_fleet(STUDY | {'prevalence': elsewhere}, TRUTH)
    assert score['prevalence'][0]['found'] == 0.0
