# SPDX-License-Identifier: Apache-2.0
"""How short a calibration may be, from rows whose truth is known."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from chamber_profile.profile.file import load_profile, profile_from_content
from chamber_profile.profile.timetable import timetable
from imu_workbench.__main__ import main
from imu_workbench.fleet.estimate import BIN_TIME_SHARES
from imu_workbench.fleet.figures import map_figure, worst_devices
from imu_workbench.fleet.page import fleet_page
from imu_workbench.fleet.short_profile import LEAST_DWELL_S, short_profile
from imu_workbench.fleet.shortening import curve_content, shortening_curve
from imu_workbench.fleet.statistics.vectors import read_vectors
from imu_workbench.fleet.study import study
from imu_workbench.fleet.summary import shortest_first, study_lines
from imu_workbench.fleet.table import FleetTable, ResultRow, write_rows
from imu_workbench.report.limits import CoefficientLimit, CoefficientLimits

TEMPERATURES = np.arange(0.0, 41.0)
LOT_STD, RUNS = 0.3, 3


def rows_of(
    device: int, draw: np.random.Generator, noise: float, seconds: float
) -> list[ResultRow]:
    """Rows of one gyroscope: runs of lines of one slope, white noise in four parts of each bin."""
    rows: list[ResultRow] = []
    run = np.repeat(np.arange(RUNS), len(TEMPERATURES))
    x = np.tile(TEMPERATURES, RUNS)
    for axis in 'xyz':
        y = (2.0 + LOT_STD * draw.normal()) * (x - 20.0) + draw.normal(size=RUNS)[run]
        parts = y[:, None] + 2.0 * noise * draw.normal(size=(len(x), 4))
        of_share = [parts[:, : int(4 * share)].mean(axis=1) for share in BIN_TIME_SHARES]
        each = [np.polyfit(x[run == r], of_share[0][run == r], 1)[0] for r in range(RUNS)]
        share = np.repeat(BIN_TIME_SHARES, len(x))
        rows.append(
            {
                'lot': 'A', 'type': 'none', 'device': f'd{device:03d}', 'source': f'd{device:03d}',
                'sensor': 'gyroscope', 'axis': axis, 'effect': 'bias_temperature',
                'role': 'fitted', 'unit': 'rad/s/K', 'coefficients': [float(np.mean(each))],
                'std': [noise / np.sqrt(RUNS * np.sum((TEMPERATURES - 20.0) ** 2))],
                'run_coefficients': each, 'held_out_rms': 1.0, 'noise_floor': 1.0,
                'measured_at': device, 'block_run': np.tile(run, len(BIN_TIME_SHARES)).tolist(),
                'block_share': share.tolist(), 'block_temperature': np.tile(x, 3).tolist(),
                'block_mean': np.concatenate(of_share).tolist(),
                'block_variance': (noise**2 / share).tolist(),
                'block_seconds': (seconds * share).tolist(), 'fingerprint': 'f', 'settings': 's',
                'version': 'v',
            }
        )  # fmt: skip
    return rows


def curve_of(folder: Path, noise: float, devices: int = 80, seconds: float = 960.0) -> dict:
    draw = np.random.default_rng(9)
    rows = [row for device in range(devices) for row in rows_of(device, draw, noise, seconds)]
    write_rows(folder, rows, 1)
    table = FleetTable(folder)
    curve = shortening_curve(table, [read_vectors(table, 'gyroscope')], [])
    assert curve is not None
    return curve_content(curve)


def point(curve: dict, temperatures: int, *, prior: bool, share: float = 1.0) -> dict:
    wanted = (temperatures, 1, prior, share)
    names = ('temperatures', 'poses', 'prior', 'share')
    return next(one for one in curve['points'] if tuple(map(one.get, names)) == wanted)


def test_a_known_lot_shortens_a_noisy_calibration(tmp_path: Path) -> None:
    curve = curve_of(tmp_path, noise=15.0)
    judged = np.sum((TEMPERATURES - 20.0) ** 2) / len(TEMPERATURES)
    full = 15.0**2 * (1 + judged / (2 * judged * len(TEMPERATURES)))
    for share in BIN_TIME_SHARES:
        # Two ends 40 K apart: slope error 15 √2 / 40 = 0.53; its prior is 0.3 wide.
        alone = point(curve, 2, prior=False, share=share)
        known = point(curve, 2, prior=True, share=share)
        slope = (15.0 * np.sqrt(2) / 40.0) ** 2 / share
        shrunk = 1 / (1 / slope + 1 / LOT_STD**2)
        assert alone['ratio'] == pytest.approx(np.sqrt((15**2 + slope * judged) / full), rel=0.04)
        assert known['ratio'] == pytest.approx(np.sqrt((15**2 + shrunk * judged) / full), rel=0.03)
        assert known['ratio_range'][0] < known['ratio'] < known['ratio_range'][1]
    # What is not measured at all is the mean of the lot.
    nothing = np.sqrt((15**2 + LOT_STD**2 * judged) / full)
    assert point(curve, 1, prior=True)['ratio'] == pytest.approx(nothing, rel=0.03)


def test_hours_are_those_of_the_profile_and_the_fewest_that_suffice_are_chosen(
    tmp_path: Path,
) -> None:
    curve = curve_of(tmp_path, noise=1.0)
    best = curve['shortest']
    assert best == curve['shortest_of']['gyroscope']
    seconds = timetable(profile_from_content(short_profile(best)))[-1].end_s
    assert best['hours'] == pytest.approx(best['poses'] * seconds / 3600.0)
    assert best['dwells_s'] == [960.0 * best['share']] * best['temperatures']
    bound = curve['good_enough']
    enough = [p['hours'] for p in curve['points'] if p['prior'] and p['ratio'] <= bound]
    assert best['hours'] == min(enough)
    assert curve['full_hours'] == pytest.approx(2 * len(TEMPERATURES) * 960.0 / 3600.0)
    hours = [point(curve, 2, prior=True, share=share)['hours'] for share in BIN_TIME_SHARES]
    np.testing.assert_allclose(np.diff(hours), [-2 * 480 / 3600.0, -2 * 240 / 3600.0])
    front = shortest_first(curve['points'], 'gyroscope')
    assert all(a['ratio'] > b['ratio'] for a, b in itertools.pairwise(front))


def test_dwells_that_are_short_already_are_not_cut(tmp_path: Path) -> None:
    curve = curve_of(tmp_path, noise=1.0, devices=20, seconds=60.0)
    assert {one['share'] for one in curve['points']} == {1.0}
    assert curve['shortest']['dwells_s'] == [LEAST_DWELL_S] * curve['shortest']['temperatures']


def test_a_lot_that_tells_nothing_has_no_curve_but_the_plan_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    draw = np.random.default_rng(9)
    rows = [row for device in range(8) for row in rows_of(device, draw, 1.0, 960.0)]
    write_rows(tmp_path, rows, 1)
    assert study(tmp_path)['shortening'] is None
    assert main(['plan', '--fleet', str(tmp_path), '-o', str(tmp_path / 'p.yaml')]) == 2
    assert 'no lot of 9 devices' in capsys.readouterr().err


def test_results_of_another_version_are_read_and_told(tmp_path: Path) -> None:
    draw = np.random.default_rng(9)
    rows = [row for device in range(6) for row in rows_of(device, draw, 1.0, 960.0)]
    write_rows(tmp_path, rows, 1)
    for file in (tmp_path / 'results').glob('*/*.parquet'):  # that one kept no shares
        pq.write_table(pq.read_table(file).drop_columns(['block_share']), file)
    found = study(tmp_path)
    assert (found['estimated'], found['other_version']) == (6, 6)
    assert any('by another version' in line for line in study_lines(found))


def test_a_device_with_fewer_runs_does_not_shorten_the_study(tmp_path: Path) -> None:
    draw = np.random.default_rng(9)
    rows = [row for device in range(30) for row in rows_of(device, draw, 1.0, 960.0)]
    for row in rows[:3]:
        kept = [k for k, run in enumerate(row['block_run']) if run]
        row |= {name: [row[name][k] for k in kept] for name in row if name.startswith('block_')}
        row['run_coefficients'] = row['run_coefficients'][1:]
    write_rows(tmp_path, rows, 1)
    table = FleetTable(tmp_path)
    curve = shortening_curve(table, [read_vectors(table, 'gyroscope')], [])
    assert curve is not None
    assert (curve.devices, max(one.poses for one in curve.points)) == (29, 2)


@pytest.mark.long
def test_the_profile_is_one_a_chamber_runs(tmp_path: Path) -> None:
    curve = curve_of(tmp_path, noise=1.0)
    written = tmp_path / 'short.yaml'
    assert main(['plan', '--fleet', str(tmp_path), '-o', str(written)]) == 0
    assert load_profile(str(written)).name == 'short_fleet'
    assert main(['plan', '--fleet', str(tmp_path), '-o', str(written)]) == 2  # it exists
    assert main(['plan', '--fleet', str(tmp_path / 'none'), '-o', str(tmp_path / 'new')]) == 2
    assert main(['plan']) == 2
    limits = CoefficientLimits({'gyroscope': {'slope': CoefficientLimit(-1e-9, 1e-9, 'rad/s/K')}})
    found = study(tmp_path, limits)
    assert found['shortening'] == curve
    assert [one['capable'] for one in found['capability']] == [False] * 3
    assert any('has Cpk' in line for line in study_lines(found))
    page = fleet_page(found, tmp_path)
    assert 'gyroscope x [m°/s/K]' in page
    assert not any('rad/s/K' in text for text in (page, *study_lines(found)))
    worst = worst_devices(found['scores'])
    figure = map_figure(found['scores'], ['gyroscope'], {worst[0]: '../lot%3DA/d"1'})
    *_, last = figure['layout']['yaxis']['ticktext']  # drawn from below: the worst is on top
    assert last == f'<a href="../lot%3DA/d&quot;1">{worst[0]}</a>'
    assert 'Capability, worst first' in page
    assert all(f'id="{name}"' in page for name in ('odd', 'control', 'prevalence', 'shortening'))
