# SPDX-License-Identifier: Apache-2.0
"""A device that is measured shortly, with the fleet as prior of its slopes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_workbench.__main__ import main
from imu_workbench.fleet.table import ResultRow, write_rows
from thermal_comp.model.file import load_model
from thermal_comp.model.values import ThermalModel

BAG = str(Path(__file__).parents[4] / 'bags' / 'dut1_x')
LOT_STD = 3e-7


def fitted(tmp_path: Path, *further: str) -> ThermalModel:
    target = tmp_path / 'model.yaml'
    assert main(['fit', BAG, '-o', str(target), '--force', *further]) == 0
    return load_model(target)


def rows_of(device: str, lot: str, slopes: np.ndarray) -> list[ResultRow]:
    return [
        {
            'lot': lot, 'type': 'none', 'device': device, 'source': f'{lot}/{device}',
            'sensor': 'gyroscope', 'axis': axis, 'effect': 'bias_temperature', 'role': 'fitted',
            'unit': 'rad/s/K', 'coefficients': [slope], 'std': [1e-11],
            'run_coefficients': [slope, slope + 2e-11, slope], 'held_out_rms': 1.0,
            'noise_floor': 1.0, 'measured_at': 0,
        }
        for axis, slope in zip('xyz', slopes.tolist(), strict=True)
    ]  # fmt: skip


def fleet(folder: Path, middle: np.ndarray) -> str:
    """Write lots A, B, C of forty devices about a middle, and the device itself, far off."""
    draw = np.random.default_rng(3)
    rows = rows_of('dut1', 'A', middle + 1.0)
    for lot in 'ABC':
        centre = middle + (1e-6 * draw.normal(size=3) if lot != 'A' else 0.0)
        for k in range(40):
            rows += rows_of(f'{lot}{k}', lot, centre + LOT_STD * draw.normal(size=3))
    write_rows(folder, rows, 1)
    return str(folder)


@pytest.mark.long
def test_slopes_are_shrunk_to_the_lot_by_as_much_as_both_are_certain(tmp_path: Path) -> None:
    alone = fitted(tmp_path).sensors
    slopes = alone['gyroscope'].coefficients[0][0]
    std = np.sqrt(np.diag(alone['gyroscope'].covariance))
    middle = slopes + 0.5 * LOT_STD
    results = fleet(tmp_path / 'fleet', middle)
    model = fitted(tmp_path, '--fleet', results, '--lot', 'A')
    shared = model.sensors['gyroscope']
    weight = 1 / LOT_STD**2 / (1 / LOT_STD**2 + 1 / std**2)
    expected = slopes + weight * (middle - slopes)
    off = np.abs(shared.coefficients[0][0] - expected)
    assert (off < 0.4 * std).all()
    assert (np.abs(expected - slopes) > 0.1 * std).all()
    assert (np.diag(shared.covariance) < std**2).all()
    np.testing.assert_allclose(
        np.sqrt(np.diag(shared.covariance)), np.sqrt(1 - weight) * std, rtol=0.15
    )
    for sensor in ('accelerometer', 'magnetometer'):  # the fleet knows nothing of them
        np.testing.assert_array_equal(
            model.sensors[sensor].coefficients[0], alone[sensor].coefficients[0]
        )
    assert any('lot A of a fleet' in note for note in model.provenance.notes)
    of_type = fitted(tmp_path, '--fleet', results).sensors['gyroscope']
    assert (np.diag(of_type.covariance) > np.diag(shared.covariance)).all()


@pytest.mark.long
def test_a_device_outside_its_lot_is_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slopes = fitted(tmp_path).sensors['gyroscope'].coefficients[0][0]
    results = fleet(tmp_path / 'fleet', slopes + 1e-5)
    capsys.readouterr()
    fitted(tmp_path, '--fleet', results, '--lot', 'A')
    assert 'warning: the gyroscope is outside lot A' in capsys.readouterr().out


def test_mistakes_about_the_fleet_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = fleet(tmp_path / 'fleet', np.zeros(3))
    call = ['fit', BAG, '-o', str(tmp_path / 'model.yaml')]
    for further, said in (
        (['--lot', 'A'], 'give its results with --fleet'),
        (['--fleet', results, '--pooled'], 'choose'),
        (['--fleet', results, '--lot', 'Q'], 'it knows --lot A, --lot B, --lot C'),
        (['--fleet', results, '--type', 'Z'], 'it knows'),
        (['--fleet', str(tmp_path / 'none'), '--lot', 'A'], 'no results here'),
    ):
        assert main([*call, *further]) == 2
        assert said in capsys.readouterr().err
    assert not (tmp_path / 'model.yaml').exists()
