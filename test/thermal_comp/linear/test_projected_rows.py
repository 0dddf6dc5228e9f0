# SPDX-License-Identifier: Apache-2.0
"""What a base takes up is gone from columns; what it takes up wholly is said to be lost."""

import numpy as np
from thermal_comp.linear.projected_rows import ProjectedRows
from thermal_comp.linear.whitening import RowWhitening
from thermal_comp.model.values import NoiseModel


def test_levels_and_base_leave_what_least_squares_leaves() -> None:
    generator = np.random.default_rng(5)
    noise = NoiseModel(np.full(3, 1e-3), np.zeros(0), np.zeros((0, 3)))
    whitening = RowWhitening([np.arange(40), np.arange(60)], [noise, noise], [1.0, 1.0])
    x = generator.normal(size=(100, 1, 1)) * np.ones((1, 3, 1))
    rows = ProjectedRows(whitening, [x])
    column = generator.normal(size=(100, 3, 1))
    left, lost = rows.projected(np.concatenate([column, 3.0 * x], axis=2), 1e-9)
    known = np.column_stack([np.arange(100) < 40, np.arange(100) >= 40, x[:, 0, 0]]).astype(float)
    for axis in range(3):
        own = column[:, axis, 0]
        expected = own - known @ np.linalg.lstsq(known, own, rcond=None)[0]
        white = whitening.whitened(expected[:, None, None] * np.ones((1, 3, 1)))[axis, :, 0]
        assert np.allclose(left[axis, :, 0], white)
    assert not lost[:, 0].any()
    assert lost[:, 1].all()
