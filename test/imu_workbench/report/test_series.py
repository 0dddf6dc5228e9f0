# SPDX-License-Identifier: Apache-2.0
"""Decimation loses points, never an extreme, and leaves holes visible."""

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from imu_workbench.report.series import binned_extremes, decimated, extreme_rows


@pytest.mark.parametrize('with_library', [True, False])
def test_four_million_points_keep_a_single_spike(monkeypatch, with_library) -> None:
    if not with_library:
        monkeypatch.setitem(sys.modules, 'tsdownsample', None)
    values = np.sin(np.arange(4_000_000) * 1e-5)
    values[1_234_567] = 7.0
    values[3_000_001] = -7.0
    rows = extreme_rows(values, 2000)
    assert len(rows) <= 2000
    assert {1_234_567, 3_000_001} <= set(rows.tolist())
    assert (np.diff(rows) > 0).all()


@given(st.lists(st.floats(-1e6, 1e6) | st.just(np.nan), max_size=300), st.integers(2, 40))
def test_extremes_survive_whatever_the_data(values, points) -> None:
    values = np.array(values, dtype=float)
    rows = extreme_rows(values, points)
    finite = values[np.isfinite(values)]
    assert np.isfinite(values[rows]).all()
    if len(finite):
        assert values[rows].min() == finite.min()
        assert values[rows].max() == finite.max()
        assert len(rows) <= max(points, 2)


def test_both_ways_keep_the_same_envelope() -> None:
    values = np.random.default_rng(3).normal(size=100_000)
    library = values[extreme_rows(values, 500)]
    own = values[binned_extremes(values, 500)]
    assert (library.min(), library.max()) == (own.min(), own.max())


def test_a_hole_stays_a_hole() -> None:
    time = np.concatenate([np.arange(1000.0), np.arange(5000.0, 6000.0)])
    shown_time, shown = decimated(time, np.ones(2000), 100, max_gap=3.0)
    assert np.isnan(shown).sum() == 1
    assert 999 < shown_time[np.isnan(shown)][0] < 5000
