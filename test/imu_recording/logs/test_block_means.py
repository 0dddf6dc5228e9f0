# SPDX-License-Identifier: Apache-2.0
"""Means of blocks are those of the whole stream, however it is cut into pieces."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.logs.block_means import BlockMeans


@pytest.mark.parametrize('cuts', [[], [1], [3, 4, 11], list(range(1, 20))])
def test_pieces_make_no_difference(cuts: list[int]) -> None:
    time = np.arange(20) * 10
    values = np.random.default_rng(1).standard_normal(20)
    means = BlockMeans(4)
    for part in np.split(np.arange(20), cuts):
        means.add(time[part], {'x': values[part]})
    stamps, columns = means.result()
    assert stamps.tolist() == [15, 55, 95, 135, 175]
    assert columns['x'] == pytest.approx([values[k : k + 4].mean() for k in range(0, 20, 4)])


def test_a_block_that_is_not_full_is_not_told() -> None:
    means = BlockMeans(3)
    means.add(np.array([0, 1]), {'x': np.array([1.0, 2.0])})
    assert means.result()[0].size == 0
    means.add(np.array([2, 3]), {'x': np.array([3.0, 99.0])})
    assert means.result()[1]['x'].tolist() == [2.0]


def test_times_whose_sum_no_integer_holds() -> None:
    late = 2**62
    means = BlockMeans(4)
    means.add(late + np.array([0, 2, 4, 6]), {'x': np.ones(4)})
    assert means.result()[0].tolist() == [late + 3]


def test_no_block_lies_across_a_clock_that_was_set_back() -> None:
    means = BlockMeans(2)
    means.add(np.array([100, 110, 120, 0, 10]), {'x': np.array([1.0, 1.0, 50.0, 3.0, 3.0])})
    stamps, columns = means.result()
    assert stamps.tolist() == [105, 5]
    assert columns['x'].tolist() == [1.0, 3.0]
