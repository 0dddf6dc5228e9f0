# SPDX-License-Identifier: Apache-2.0
"""A note on reading stands once, with its runs."""

from __future__ import annotations

from imu_workbench.report.html.measured import notes


def test_a_note_of_every_run_is_told_once() -> None:
    runs = [{'name': name, 'notes': ['a gap'], 'unplaced': {}} for name in 'ab']
    assert notes({'recordings': runs}) == [{'text': 'a gap', 'runs': 'all 2 runs'}]
    runs[1] |= {'notes': [], 'unplaced': {'imu/mag': 1}}
    assert [note['runs'] for note in notes({'recordings': runs})] == ['a', 'b']
