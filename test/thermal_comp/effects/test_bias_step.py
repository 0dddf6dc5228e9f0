# SPDX-License-Identifier: Apache-2.0
"""Several steps of one effect: a time each, and a duration each or one for all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.user_error import UserError
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.bias_step import BiasStep
from thermal_comp.effects.effect import Campaign, joined_effects


def conditions() -> Conditions:
    still = np.zeros((80, 3))
    return Conditions(np.arange(80) * 10.0, np.full(80, 20.0), still, still, still)


def test_joined_steps_keep_their_columns() -> None:
    alone = BiasStep((200.0,), (0.0,)), BiasStep((400.0,), (60.0,))
    (joined,) = joined_effects(alone)
    expected = np.hstack([step.columns(conditions())[0] for step in alone])
    assert np.array_equal(joined.columns(conditions())[0], expected)


def test_one_duration_is_that_of_every_step() -> None:
    columns, _ = BiasStep((200.0, 400.0), (100.0,)).columns(conditions())
    assert columns[[25, 45], [0, 1]] == pytest.approx([0.5, 0.5])


def test_other_numbers_of_durations_are_refused() -> None:
    with pytest.raises(UserError, match='3 step times and 2 durations; give one duration'):
        BiasStep((1.0, 2.0, 3.0), (1.0, 2.0))


def test_the_edge_of_a_known_step_is_no_second_one() -> None:
    campaign = Campaign(
        cycles=0,
        durations=(30_000.0, 30_000.0),
        times_before=(0.0, 40_000.0),
        spectral_lines=list,
        step_times=lambda: [(1, 7015.0, 0.0), (0, 7015.0, 0.0), (1, 12_010.0, 0.0)],
    )
    known = replace(campaign, occurred=[(1, 7000.0)])
    before, after = (
        {(c.run, c.effect.occurrences) for c in BiasStep.search_grid(one)}
        for one in (campaign, known)
    )
    assert before - after == {(1, (7015.0,)), (1, (7200.0,)), (None, (7200.0,))}
    assert (0, (7015.0,)) in after
