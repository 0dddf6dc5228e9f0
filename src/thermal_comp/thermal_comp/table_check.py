# SPDX-License-Identifier: Apache-2.0
"""Published statistics under the microscope: what cannot be, and what may explain it."""

from __future__ import annotations

from collections.abc import Sequence

from thermal_comp.table_check_channels import field_jumps, flips, startups, units
from thermal_comp.table_check_numbers import (
    extremes,
    mean_outside,
    order_broken,
    spread_beyond_range,
)
from thermal_comp.table_check_repeats import repeated_columns
from thermal_comp.table_finding import TableFinding
from thermal_comp.table_rows import Row, TableError, read_table

__all__ = ['Row', 'TableError', 'TableFinding', 'check_rows', 'read_table']

CHECKS = (
    order_broken,
    mean_outside,
    spread_beyond_range,
    extremes,
    startups,
    flips,
    units,
    field_jumps,
    repeated_columns,
)
"""Single rows first, then the rows of one device, then devices beside each other."""


def check_rows(rows: Sequence[Row]) -> list[TableFinding]:
    """Return everything that cannot be or that asks for an explanation."""
    return [finding for check in CHECKS for finding in check(rows)]
