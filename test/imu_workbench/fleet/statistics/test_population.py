# SPDX-License-Identifier: Apache-2.0
"""Mean and covariance of lots whose truth is known, from estimates with errors."""

from __future__ import annotations

import numpy as np
import pytest
from imu_workbench.fleet.statistics.population import device_effects, fit_population, populations

from .drawn_devices import MIX, vectors


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


@pytest.mark.long
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
