# SPDX-License-Identifier: Apache-2.0
"""Uncertainty budgets: intervals that hold the truth as often as they say."""

import numpy as np
import pytest
from imu_workbench.report.certificate.budget import Input, Measurand, budget_of, scatter_inputs


def test_monte_carlo_sees_what_is_not_linear() -> None:
    small = budget_of(
        Measurand(1.0, span=60.0, power=1), 'T/K', [Input('c', 0.1, 'K', kind='span')]
    )
    assert small.monte_carlo == pytest.approx(small.combined, rel=0.02)
    large = budget_of(
        Measurand(1.0, span=6.0, power=2), 'T/K²', [Input('c', 1.2, 'K', kind='span')]
    )
    assert large.monte_carlo > 1.1 * large.combined


def covered(generator, scatter, devices: int) -> float:
    """Return how many 95 % intervals hold the truth, of slopes that scatter by noise, cycle, run.

    `scatter` draws the three standard deviations of a device.
    """
    number = np.repeat(np.arange(3), 4)
    hits = 0
    for _ in range(devices):
        noise, cycle, runs = scatter(generator)
        values = (
            generator.normal(0.0, runs, 3)[number]
            + generator.normal(0.0, cycle, 12)
            + generator.normal(0.0, noise, 12)
        )
        inputs, _ = scatter_inputs(noise / np.sqrt(12), 200.0, values, number, 'T/K')
        budget = budget_of(Measurand(float(values.mean())), 'T/K', inputs, draws=2)
        hits += abs(budget.value) <= budget.coverage_factor * budget.combined
    return hits / devices


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """Over devices from one whose noise hides everything to one that every run changes."""

    def any_device(generator):
        return 1.0, 10.0 ** generator.uniform(-1.5, 0.5), 10.0 ** generator.uniform(-1.5, 0.5)

    assert covered(np.random.default_rng(3), any_device, 1000) == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize(
    'sigma', [(1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.3, 1.0, 2.0), (1.0, 0.0, 1.0)]
)
def test_no_kind_of_device_is_far_from_it(sigma) -> None:
    """Two degrees of freedom between runs cannot tell a small scatter from none."""
    share = covered(np.random.default_rng(3), lambda _: sigma, 1000)
    assert 0.91 < share < 0.985, sigma


def test_scatter_has_the_freedom_of_the_mean_square_it_adds_up_to() -> None:
    """A run-to-run scatter that barely exceeds the cycles' has that of the runs, never less."""
    values = np.array([0.9, 1.1, 1.13, 1.33])
    inputs, _ = scatter_inputs(0.01, 200.0, values, np.array([0, 0, 1, 1]), 'T/K')
    budget = budget_of(Measurand(1.115), 'T/K', inputs, draws=2)
    between = np.var([1.0, 1.23], ddof=1) / 2.0
    assert budget.combined**2 == pytest.approx(between)
    assert budget.degrees == pytest.approx(1.0)
    tilted = [*inputs, Input('tilt', budget.combined, 'T/K', shape='rectangular')]
    assert budget_of(Measurand(1.115), 'T/K', tilted, draws=2).degrees == pytest.approx(4.0)
    with pytest.raises(ValueError, match='dof'):
        budget_of(Measurand(1.0), 'T/K', [Input('noise', 1.0, 'T/K', 0.5)], draws=2)
