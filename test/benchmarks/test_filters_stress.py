# SPDX-License-Identifier: Apache-2.0
"""Situations of benchmarks/filters_stress.py at a small size: one seed, error and covariance."""

from __future__ import annotations

import pytest
from filters_stress import judge_run
from orientation_filters.filters import FILTERS
from stress_situations import SITUATIONS, Situation

SEED = 0
LONG = ('never at rest', 'ramp')
SHORT = ('first 0.25 s shaken, at 10 s', 'starts in motion, 2 m/s²')
"""Too soon after the start to know that the noises are smaller than assumed."""


@pytest.mark.parametrize(
    'situation',
    [s for s in SITUATIONS if not any(word in s.name for word in LONG)],
    ids=lambda situation: situation.name,
)
def test_error_and_covariance_in_a_situation(situation: Situation) -> None:
    run = situation.make(SEED)
    for name in FILTERS:
        rms, nees, coverage = judge_run(run, name)
        assert rms <= 1.5 * situation.limit, name
        assert 0.1 < nees < 3.0 or situation.name in SHORT, name
        assert coverage >= 0.8, name


def test_a_heading_seen_from_a_wrong_tilt_is_not_believed() -> None:
    """One sample of a shaken device is 90° off, and shows the field as if it did not dip."""
    situation = next(s for s in SITUATIONS if s.name == SHORT[0])
    for name in FILTERS:
        rms, _, _ = judge_run(situation.make(301), name)
        assert rms <= situation.worst, name
