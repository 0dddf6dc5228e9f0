# SPDX-License-Identifier: Apache-2.0
"""Ice that grows and melts by degrees is ice too."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects.operators import grow_and_melt

from ..campaign import chamber, measured_by, run

UP = ('+x', '+z')

AXES = np.array([1.0, -0.6, 0.3])


def test_ice_by_degrees_is_a_sum_of_degrees_between_none_and_all_water() -> None:
    time = np.arange(0.0, 4000.0, 10.0)
    temperature = 15.0 * np.cos(time / 300.0)
    ice, (last, amount) = grow_and_melt(time, temperature, 400.0, 250.0, by_degrees=True)
    frozen, expected = 0.0, [0.0]  # water of 4000 K s; it melts at 8/5 of the pace of growth
    for degrees in temperature[1:]:
        frozen = np.clip(frozen - 10.0 * degrees * (1.6 if degrees > 0.0 else 1.0), 0.0, 4000.0)
        expected.append(frozen / 4000.0)
    assert max(expected) == 1.0
    np.testing.assert_allclose(ice, expected, atol=1e-12)
    assert (last, amount) == (time[-1], ice[-1])


@pytest.mark.long
def test_ice_by_degrees_has_its_name() -> None:
    time, temperature = chamber()[:2]
    degrees = np.cumsum(np.where(temperature < 0.0, -temperature, -3.0 * temperature))
    frozen = degrees - np.minimum.accumulate(np.minimum(degrees, 0.0))  # of water without end
    frozen *= (time[1] - time[0]) / 36_000.0
    error = {'angular_velocity': 3e-4 * frozen[:, None] * AXES}
    runs = [run(up, seed=k, error=error) for k, up in enumerate(UP)]
    (found,) = (f for f in diagnose(measured_by(runs, 'gyroscope')).findings if f.kind == 'effect')
    assert (found.name, found.ambiguous_with) == ('icing', ())
    assert found.probability is not None
    assert found.probability > 0.9
    assert found.parameters['by_degrees']['value'] == 1.0
