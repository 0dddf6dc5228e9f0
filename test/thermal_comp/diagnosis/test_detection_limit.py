# SPDX-License-Identifier: Apache-2.0
"""What is said to be the smallest effect that is found: twice of it is, two fifths are not."""

import numpy as np
import pytest
from thermal_comp.diagnosis.diagnose import diagnose

from ..campaign import chamber, lagging, measured_by, run

AXES = np.array([1.0, -0.8, 1.2])


def recordings(share: float, limit: float = 0.0):
    """Return two runs of a gyroscope that lags by a share of the limit [rad/s rms]."""
    time, temperature, *_ = chamber()
    lag = temperature - lagging(temperature, 300.0, float(time[1] - time[0]))
    error = (lag - lag.mean())[:, None] * AXES
    error *= share * limit / np.sqrt((error**2).mean())
    runs = [
        run(up, seed=k, error={'angular_velocity': error}) for k, up in enumerate(('+x', '-z'))
    ]
    return measured_by(runs, 'gyroscope')


@pytest.fixture(scope='module')
def limits() -> dict[str, float]:
    state = diagnose(recordings(0.0)).sensors['gyroscope']
    assert state.verdict == 'complete'
    return dict(state.smallest_found)


def test_every_effect_that_was_asked_has_a_limit_below_the_noise_of_a_block(limits) -> None:
    assert {'thermal_lag', 'thermal_hysteresis', 'bias_creep'} <= set(limits)
    assert all(0.0 < rms < 1e-3 for rms in limits.values())


@pytest.mark.parametrize(
    ('share', 'found'), [(2.0, True), pytest.param(0.4, False, marks=pytest.mark.long)]
)
def test_the_limit_is_where_a_lag_begins_to_be_found(limits, share, found) -> None:
    diagnosis = diagnose(recordings(share, limits['thermal_lag']))
    assert (diagnosis.sensors['gyroscope'].verdict != 'complete') == found
