# SPDX-License-Identifier: Apache-2.0
"""A state in compiled memory gives what the module's plain `update` gives, whatever is changed."""

from __future__ import annotations

import numpy as np
import pytest
from orientation_filters.ahrs import filterpy_kalman
from orientation_filters.filters import FILTERS, filter_parameters
from orientation_filters.live.state import CompiledState, PlainState, live_state
from orientation_filters.parameters import PRESET_NAMES

from ..recordings import moving, samples_of


@pytest.mark.parametrize('name', FILTERS)
@pytest.mark.parametrize('preset', PRESET_NAMES)
def test_the_compiled_state_follows_the_plain_one(name: str, preset: str) -> None:
    first = filter_parameters(name, preset=preset).kernel_params()
    later = filter_parameters(name, preset=preset, bias_limit=1e-3).kernel_params()
    compiled, plain = live_state(FILTERS[name], first), PlainState(FILTERS[name], first)
    assert isinstance(compiled, CompiledState)
    for i, sample in enumerate(samples_of(moving(2, seconds=1.0))):
        if i == 50:
            compiled.set_params(later)
            plain.set_params(later)
        one, other = compiled.update(sample), plain.update(sample)
        assert one.flags == other.flags
        np.testing.assert_array_equal(one.orientation, other.orientation)
        np.testing.assert_array_equal(one.covariance, other.covariance)
    assert compiled.state.stamp == plain.state.stamp > 0
    assert compiled.state.bias == plain.state.bias


def test_changed_parameters_apply_and_the_state_stays() -> None:
    slow = filter_parameters('complementary', cutoff_hz=0.1).kernel_params()
    fast = filter_parameters('complementary', cutoff_hz=10.0).kernel_params()
    samples = samples_of(moving(2, seconds=1.0))
    changed, kept = (live_state(FILTERS['complementary'], slow) for _ in range(2))
    for sample in samples[:50]:
        changed.update(sample)
        kept.update(sample)
    changed.set_params(fast)
    assert changed.state == kept.state
    assert changed.update(samples[50]).orientation != kept.update(samples[50]).orientation


def test_a_module_without_step_runs_in_plain_python() -> None:
    params = filter_parameters('ahrs', implementation='filterpy').kernel_params()
    state = live_state(filterpy_kalman, params)
    assert isinstance(state, PlainState)
    found = [state.update(sample) for sample in samples_of(moving(2, seconds=0.1))]
    assert np.linalg.norm(found[-1].orientation) == pytest.approx(1.0)
