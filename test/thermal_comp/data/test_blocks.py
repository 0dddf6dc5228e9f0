# SPDX-License-Identifier: Apache-2.0
"""Blocks are as long as what was sampled allows; cycles, else contiguous parts, are held out."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.blocks import contiguous_parts
from thermal_comp.data.preparation import prepare

from .at_rest import still


def test_gaps_leave_slots_empty_and_are_told() -> None:
    whole = still(1.0, 10.0)
    time = whole.time
    (run,) = prepare([whole.rows((time < 1000.0) | (time >= 1300.0))], period=20.0)
    assert set(range(180)) - set(run.slot.tolist()) == set(range(50, 65))
    assert any('300 s in gaps' in note for note in run.notes)
    assert run.time[50] == pytest.approx(1310.0, abs=0.1)


def test_cycles_are_held_out_and_without_them_twelve_blocks() -> None:
    recording = still(4.0, 0.5)
    cycle = (recording.time // 3600).astype(np.int64)
    (run,) = prepare([replace(recording, cycle=cycle)])
    assert run.has_cycles
    assert np.unique(run.cv_group).tolist() == [0, 1, 2, 3]
    (run,) = prepare([replace(recording, temperature=20.0 + 5.0 * recording.time / 3600.0)])
    assert not run.has_cycles
    assert np.unique(run.cv_group).tolist() == list(range(1, 13))
    assert any('12 contiguous blocks' in note for note in run.notes)


@pytest.mark.parametrize(('blocks', 'parts'), [(3, 3), (40, 5), (70, 7), (5000, 12)])
def test_a_part_that_is_held_out_holds_enough_blocks(blocks: int, parts: int) -> None:
    assert np.unique(contiguous_parts(blocks)).tolist() == list(range(1, parts + 1))


def test_runs_of_one_campaign_have_blocks_of_one_length() -> None:
    long, short = still(3.0, 1.0), still(0.25, 10.0, seed=1, run='short')
    runs = prepare([long, short])
    assert [run.period for run in runs] == [20.0, 20.0]
    assert len(runs[1]) == 45
    alone = prepare([short])[0]
    assert alone.period == pytest.approx(2.0)
    np.testing.assert_allclose(
        runs[1].measured['gyroscope'],
        alone.measured['gyroscope'].reshape(45, 10, 3).mean(axis=1),
        rtol=0.0,
        atol=1e-12,
    )


def test_bursts_an_hour_apart_have_the_blocks_of_what_was_sampled() -> None:
    whole = still(5.0, 20.0)
    (bursts,) = prepare([whole.rows(whole.time % 3600.0 < 45.0)])
    (alone,) = prepare([still(225.0 / 3600.0, 20.0)])
    assert bursts.period == alone.period == 0.5
    assert len(bursts) == pytest.approx(len(alone), abs=10)
    day = still(60.0, 1.0)
    (sparse,) = prepare([day.rows(day.time % 3600.0 < 5.0)])
    assert (sparse.slot[-1] + 1) <= 110_000
