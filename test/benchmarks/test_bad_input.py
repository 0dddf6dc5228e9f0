# SPDX-License-Identifier: Apache-2.0
"""Twenty damaged files, each given to a verb: an answer or one line, quickly, every time."""

from __future__ import annotations

from pathlib import Path

from bad_input import FUZZED_VERBS, fuzz_case, prepared

CASES = 20


def test_no_damaged_file_hangs_a_verb_or_ends_in_a_traceback(tmp_path: Path) -> None:
    bench = prepared(tmp_path / 'bench', rate=0.2)
    cells = [fuzz_case(bench, seed) for seed in range(CASES)]
    assert [f'{c.input} {c.verb}: {c.complaint}' for c in cells if c.complaint] == []
    assert {c.verb for c in cells} == set(FUZZED_VERBS)
    # The damage is felt: not every file is so well that nothing is said.
    assert 0.2 * CASES < sum(c.code == 2 for c in cells) < 0.9 * CASES
