# SPDX-License-Identifier: Apache-2.0
"""Sums over parts of runs give the held-out error that a fit to all other parts leaves."""

import numpy as np
from thermal_comp.comparison.held_out import hold_out
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.fitting.part_sums import LONG_PARTS, part_sums
from thermal_comp.noise.estimation import fit_noise

from ..campaign import chamber, lagging, run

DIE = chamber(3, 20.0)[1]
ERROR = {'angular_velocity': np.outer(DIE - lagging(DIE, 400.0, 20.0), [4e-5, -3e-5, 5e-5])}


def test_the_errors_are_those_of_leaving_each_cycle_out() -> None:
    runs = prepare([
        run(up, seed=k, cycles=3, period=20.0, error=ERROR) for k, up in enumerate(('+x', '+z'))
    ])  # fmt: skip
    noise = fit_noise(runs, 'gyroscope')
    line, lag = BiasTemperature(), ThermalLag(400.0)
    sums = part_sums(runs, 'gyroscope', [line], [lag], noise)
    for effects, columns in (
        ((line,), sums.known),
        ((line, lag), np.append(sums.known, sums.places[lag])),
    ):
        held = hold_out(runs, {'gyroscope': effects}, {'gyroscope': noise})
        free = np.zeros((3, len(columns)))
        found = [
            sums.errors(part, columns, free) * sums.rows[sums.held_out(part), None]
            for part in sums.parts()
        ]
        mine = np.sqrt(np.concatenate(found).sum(axis=0) / sums.rows[sums.part > 0].sum())
        assert np.allclose(mine, held.rms('gyroscope'), rtol=0.03)


def test_thermal_cycles_are_never_joined_to_longer_parts() -> None:
    runs = prepare([run(seed=1, cycles=6, period=20.0)])
    sums = part_sums(runs, 'gyroscope', [BiasTemperature()], [], fit_noise(runs, 'gyroscope'))
    assert sums.cycles
    assert sums.longer().parts() == [1, 2, 3, 4, 5, 6]


def test_parts_of_a_run_without_cycles_are_joined_to_four() -> None:
    one = run(seed=1, cycles=1, period=20.0)
    runs = prepare([one])
    sums = part_sums(runs, 'gyroscope', [BiasTemperature()], [], fit_noise(runs, 'gyroscope'))
    assert not sums.cycles
    assert sums.longer().parts() == list(range(1, min(len(sums.parts()), LONG_PARTS) + 1))
