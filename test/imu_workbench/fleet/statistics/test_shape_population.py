# SPDX-License-Identifier: Apache-2.0
"""Time constants and coefficients of a lot, from devices whose truth is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.recording import FloatArray
from imu_workbench.fleet.page import fleet_page
from imu_workbench.fleet.statistics.shape_population import ShapeEvidence, fit_shapes
from imu_workbench.fleet.study import study
from imu_workbench.fleet.summary import study_lines
from imu_workbench.fleet.table import write_rows
from scipy.signal import lfilter

FORMS = np.geomspace(10.0, 3600.0, 13)
PERIOD = 10.0
MEAN = np.array([2.0, -1.0, 0.5, np.log(300.0)])
STD = np.array([0.5, 0.5, 0.3, 0.35])
SHARE = 0.6


def lag(time_constant: float) -> FloatArray:
    """Return T_lag − T of a cycle from 20 to −10 to 50 to 20 °C at 2 K/min, in white noise."""
    corners = [0.0, 15.0, 25.0, 55.0, 65.0, 80.0]
    time = np.arange(0.0, 80.0, PERIOD / 60.0)
    temperature = np.interp(time, corners, [20.0, -10.0, -10.0, 50.0, 50.0, 20.0])
    keep = np.exp(-PERIOD / time_constant)
    lagged = lfilter([1.0 - keep], [1.0, -keep], temperature - 20.0) + 20.0
    column = lagged - temperature
    column -= column.mean()
    return np.asarray(column)


def drawn(n: int, noise: float, seed: int) -> tuple[ShapeEvidence, FloatArray]:
    """Return what n devices tell, and (n, 4) the truth; NaN in those that lack the effect."""
    draw = np.random.default_rng(seed)
    correlation = np.eye(4)
    correlation[0, 3] = correlation[3, 0] = -0.6
    truth = draw.multivariate_normal(MEAN, correlation * np.outer(STD, STD), n)
    truth[draw.random(n) > SHARE] = np.nan
    columns = np.array([lag(form) for form in FORMS])
    size = (columns**2).sum(axis=1)
    measured = noise * draw.normal(size=(n, columns.shape[1], 3))
    for device in np.flatnonzero(np.isfinite(truth[:, 0])):
        *coefficients, log_shape = truth[device]
        measured[device] += np.outer(lag(float(np.exp(log_shape))), coefficients)
    c = np.einsum('kt,nta->nka', columns, measured) / size[:, None]
    std = np.broadcast_to((noise / np.sqrt(size))[:, None], c.shape)
    return ShapeEvidence(np.log(FORMS), c, std), truth


@pytest.mark.parametrize(('noise', 'seed'), [(2.0, 1), (20.0, 2)])
def test_mean_scatter_and_share_of_a_lot_are_those_it_was_drawn_from(
    noise: float, seed: int
) -> None:
    evidence, truth = drawn(200, noise, seed)
    carried = truth[np.isfinite(truth[:, 0])]
    fit = fit_shapes(evidence)
    assert fit.share == pytest.approx(len(carried) / len(truth), abs=0.08)
    std = np.sqrt(np.diag(fit.mean_covariance))
    assert (np.abs(fit.mean - MEAN) < 4.0 * std).all()
    assert (std < 0.35 * STD).all()
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), STD, rtol=0.3)
    of_both = fit.covariance[0, 3] / np.sqrt(fit.covariance[0, 0] * fit.covariance[3, 3])
    assert of_both == pytest.approx(-0.6, abs=0.25)


def test_the_deviation_of_the_mean_is_what_repeated_lots_scatter_by() -> None:
    fits = [fit_shapes(drawn(80, 8.0, seed)[0]) for seed in range(10, 26)]
    score = [(fit.mean - MEAN) / np.sqrt(np.diag(fit.mean_covariance)) for fit in fits]
    assert 0.6 < np.sqrt(np.mean(np.square(score))) < 1.6


def test_page_and_terminal_tell_the_time_constant_of_a_lot(tmp_path: Path) -> None:
    evidence, _ = drawn(60, 8.0, 3)
    rows = [
        {
            'lot': 'A', 'type': 'none', 'device': f'd{n:03d}', 'source': f'd{n:03d}',
            'sensor': 'gyroscope', 'axis': axis, 'effect': 'thermal_lag', 'role': 'candidate',
            'forms': [f'time_constant {form:.4g}' for form in FORMS], 'degrees': 1,
            'shapes': FORMS.tolist(), 'coefficients': evidence.coefficients[n, :, a].tolist(),
            'std': evidence.std[n, :, a].tolist(),
            'gain': ((evidence.coefficients / evidence.std)[n, :, a] ** 2).tolist(),
        }
        for n in range(60)
        for a, axis in enumerate('xyz')
    ]  # fmt: skip
    write_rows(tmp_path, rows, 1)
    assert study(tmp_path, catalogue={})['shapes'] == []  # the file of an effect was not given
    found = study(tmp_path)
    (one,) = found['shapes']
    assert one['median_range'][0] < 300.0 < one['median_range'][1]
    assert one['unit'] == 'rad/s/K'
    (line,) = (line for line in study_lines(found) if 'time_constant' in line)
    assert 'from device to device' in line
    assert ' m°/s/K; ' in line
    page = fleet_page(found, tmp_path)
    assert 'what the devices that carry them share' in page
    assert 'thermal_lag [m°/s/K]' in page
