# SPDX-License-Identifier: Apache-2.0
"""Products of a table that grows beyond its room, is cut back, and is added to."""

import numpy as np
import pytest
from thermal_comp.linear import product_table
from thermal_comp.linear.product_table import ProductTable

RNG = np.random.default_rng(11)
ROWS = 30
TARGET = RNG.standard_normal((3, ROWS))


def grown(table: ProductTable, *widths: int) -> list[slice]:
    places = table.append([RNG.standard_normal((ROWS, 3, width)) for width in widths])
    table.settle(places, TARGET)
    return places


def test_products_are_those_of_the_columns_however_it_has_grown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(product_table, 'FIRST_COLUMN_CAPACITY', 4)
    table = ProductTable(ROWS)
    grown(table, 1, 2)
    table.equations([0, 2])
    grown(table, 3, 2)
    table.width = 6  # forgets the last two; others take their place
    grown(table, 2)
    columns = [7, 0, 3, 2]
    normal, right = table.equations(columns)
    for axis in range(3):
        own = table.columns[axis, columns]
        np.testing.assert_allclose(normal[axis], own @ own.T)
        np.testing.assert_allclose(right[axis], own @ TARGET[axis])
    every = table.columns[:, :8]
    np.testing.assert_allclose(table.products(range(8))[0], every @ every.transpose(0, 2, 1))


def test_what_is_added_counts_in_one_axis_and_stays() -> None:
    table = ProductTable(ROWS)
    place = grown(table, 2)[0]
    before, right_before = (values.copy() for values in table.equations([0, 1]))
    table.add(range(place.start, place.stop), np.eye(2), np.ones(2))
    grown(table, 1)
    table.products([2])
    normal, right = table.equations([0, 1])
    np.testing.assert_allclose(normal.sum(axis=0), before.sum(axis=0) + np.eye(2))
    np.testing.assert_allclose(right.sum(axis=0), right_before.sum(axis=0) + 1.0)
