# SPDX-License-Identifier: Apache-2.0
"""What the statistics of a fleet find in populations whose truth is known."""

from __future__ import annotations

import string
from collections.abc import Sequence

import numpy as np
import pytest
from imu_workbench.fleet.statistics.clusters import find_clusters
from imu_workbench.fleet.statistics.control import control_chart
from imu_workbench.fleet.statistics.population import device_effects, fit_population, populations
from imu_workbench.fleet.statistics.prevalence import SHARES, joint_evidence
from imu_workbench.fleet.statistics.screening import Screening, odd_devices, screen
from imu_workbench.fleet.statistics.vectors import Vectors

MIX = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.3, 0.2, 0.9]])
"""Axes of a lot correlate."""


def vectors(coefficients: np.ndarray, misfit: np.ndarray, lots: Sequence[str]) -> Vectors:
    n = len(coefficients)
    return Vectors(
        'gyroscope', 'rad/s/K', np.array([f'd{k:05d}' for k in range(n)]), np.full(n, 'none'),
        np.array(lots), coefficients, np.full((n, 3), 0.01), np.full((n, 3), 0.01),
        np.full(n, 3), misfit, np.arange(n),
    )  # fmt: skip


def test_the_population_is_told_apart_from_the_error_of_the_estimates() -> None:
    draw = np.random.default_rng(1)
    truth = np.array([5.0, -2.0, 1.0]) + draw.normal(size=(3000, 3)) @ MIX.T
    std = draw.uniform(0.3, 1.5, (3000, 3))
    measured = truth + std * draw.normal(size=(3000, 3))
    mean, of_mean, covariance = fit_population(measured, std**2)
    np.testing.assert_allclose(covariance, MIX @ MIX.T, atol=0.12)
    assert (np.abs(mean - [5.0, -2.0, 1.0]) < 4 * np.sqrt(np.diag(of_mean))).all()
    shrunk, posterior = device_effects(measured, std**2, mean, covariance)
    left = shrunk - truth
    assert (left**2).mean() < 0.75 * ((measured - truth) ** 2).mean()
    distance = np.einsum('ni,nij,nj->n', left, np.linalg.inv(posterior), left)
    assert 2.85 < distance.mean() < 3.15  # the posterior says how far it is off


def test_the_scatter_of_few_devices_is_not_told_too_small() -> None:
    draw = np.random.default_rng(8)
    found = []
    for _ in range(150):
        values = draw.normal(size=(8, 3)) @ MIX.T + 0.5 * draw.normal(size=(8, 3))
        found.append(fit_population(values, np.full((8, 3), 0.25))[2])
    ratio = np.trace(np.mean(found, axis=0)) / np.trace(MIX @ MIX.T)
    assert ratio == pytest.approx(1.0, abs=0.08)  # 7 / 8 where the mean were known


def test_a_lot_of_few_devices_is_shrunk_to_its_type_and_others_hardly() -> None:
    raw, shrunk, large, distances = [], [], [], []
    for seed in range(20):
        draw = np.random.default_rng(seed)
        lots = np.array(['A'] * 60 + ['B'] * 60 + ['C'] * 60 + ['D'] * 60 + ['E'] * 60 + ['F'] * 2)
        means = dict(zip('ABCDEF', 0.5 * draw.normal(size=(6, 3)) + [5.0, -2.0, 1.0], strict=True))
        truth = np.array([means[lot] for lot in lots])
        values = truth + draw.normal(size=(302, 3)) @ MIX.T + 0.01 * draw.normal(size=(302, 3))
        found, (of_type,) = populations(vectors(values, np.zeros(302), list(lots)))
        of_lot = {one.lot: one for one in found}
        assert of_type.lots == 5  # two devices tell nothing of it
        few = of_lot['F']
        raw.append(values[-2:].mean(axis=0) - means['F'])
        shrunk.append(few.mean - means['F'])
        distances.append(shrunk[-1] @ np.linalg.solve(few.mean_covariance, shrunk[-1]))
        large.append(of_lot['A'].mean - values[:60].mean(axis=0))
        np.testing.assert_allclose(few.covariance, of_type.within)
    assert np.square(shrunk).mean() < 0.7 * np.square(raw).mean()
    # χ² of three axes has 2.4; five lots know how they scatter but roughly.
    assert 1.2 < np.median(distances) < 4.5
    assert np.abs(large).max() < 0.15
    alone = vectors(values[-2:], np.zeros(2), ['F', 'F'])
    assert populations(alone) == ([], [])


@pytest.mark.parametrize(('lots', 'seed'), [('AB', 2), (string.ascii_letters[:32], 11)])
def test_screening_finds_outliers_of_four_sigma_and_leaves_the_others_in_peace(
    lots: str, seed: int
) -> None:
    draw = np.random.default_rng(seed)
    values, misfit = draw.normal(size=(4000, 3)) @ MIX.T, 0.02 * draw.normal(size=4000)
    seeded, foreign = np.arange(0, 4000, 80), np.arange(40, 4000, 400)
    values[seeded, 1] = 4.0 * draw.choice([-1.0, 1.0], len(seeded))
    misfit[foreign] += 0.3
    fleet = vectors(values, misfit, np.repeat(list(lots), 4000 // len(lots)))
    screened = screen(fleet)
    odd = {one.device for one in odd_devices([(fleet, screened)] * 3)}  # level of three sensors
    wanted = {fleet.device[k] for k in (*seeded, *foreign)}
    assert len(odd & wanted) >= 0.95 * len(wanted)
    assert len(odd - wanted) <= 0.01 * (4000 - len(wanted))
    assert isinstance(screened, Screening)


def test_clusters_are_found_not_told() -> None:
    draw = np.random.default_rng(3)
    centres = draw.normal(0.0, 6.0, (6, 3))
    own = draw.integers(6, size=180)
    fleet = vectors(centres[own] + draw.normal(size=(180, 3)) @ MIX.T, own * 0.0, ['A'] * 180)
    found = find_clusters([fleet], [True] * 180)
    assert found.count == 6
    share = [np.unique(own[found.label == k], return_counts=True)[1].max() for k in range(6)]
    assert sum(share) > 0.97 * 180
    one = vectors(draw.normal(size=(180, 3)), np.zeros(180), ['A'] * 180)
    assert find_clusters([one], [True] * 180).count == 1


def test_thirty_devices_name_what_none_shows_alone() -> None:
    draw = np.random.default_rng(4)
    has = np.arange(30) < 24
    gain = draw.chisquare(3, (30, 1)) * np.where(has, 3.0, 1.0)[:, None]  # g = 2
    joint, single = joint_evidence(gain, 3)
    assert np.median(single.max(axis=2)) < 3.0
    assert joint.max() > 5.0
    weight = np.exp(joint - joint.max()).sum(axis=(0, 1))
    assert 0.5 < weight @ SHARES / weight.sum() < 1.0
    nothing, _ = joint_evidence(draw.chisquare(3, (30, 1)), 3)
    assert np.log(np.exp(nothing).mean()) < 0.0


def test_a_control_chart_sees_a_step_and_a_wild_value() -> None:
    draw = np.random.default_rng(5)
    values = draw.normal(size=200)
    assert len(control_chart(values).beyond) <= 3
    values[50] = 9.0
    values[150:] += 2.0
    chart = control_chart(values)
    assert 50 in chart.beyond
    assert any(place > 155 for place in chart.on_one_side)
