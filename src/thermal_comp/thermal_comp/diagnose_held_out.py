# SPDX-License-Identifier: Apache-2.0
"""How well effects foresee a part of the campaign they were not fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thermal_comp.diagnose_bank import ColumnBank, Term


def held_out_chi_square(bank: ColumnBank, terms: Sequence[Term], part: int) -> float:
    """Return χ² of one part, predicted from the others, in whitened rows."""
    kept = bank.fold != part
    own, common = bank.split_sizes(terms)
    designs = bank.design(terms)
    blocks, targets, tests, wanted = [], [], [], []
    for axis in range(3):
        base = bank.base[axis]
        columns = np.zeros((len(base), 3 * (base.shape[1] + own) + common))
        start = axis * (base.shape[1] + own)
        columns[:, start : start + base.shape[1]] = base
        columns[:, start + base.shape[1] : start + base.shape[1] + own] = designs[axis][:, :own]
        columns[:, columns.shape[1] - common :] = designs[axis][:, own:]
        blocks.append(columns[kept])
        targets.append(bank.target[axis][kept])
        tests.append(columns[~kept])
        wanted.append(bank.target[axis][~kept])
    train = np.concatenate(blocks)
    normal = train.T @ train
    right = train.T @ np.concatenate(targets)
    answer = np.linalg.lstsq(normal, right, rcond=1e-10)[0]
    return float(((np.concatenate(wanted) - np.concatenate(tests) @ answer) ** 2).sum())
