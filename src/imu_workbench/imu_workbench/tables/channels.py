# SPDX-License-Identifier: Apache-2.0
"""Checks over the rows of one channel or device: start-up samples, flips, units, field jumps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from imu_workbench.tables.rows import (
    ACCELERATION_FACTORS,
    FIELD_FACTORS,
    SI_FACTORS,
    StatisticsRow,
    TableFinding,
    distinct,
    norms,
)

STARTUP_AGREEMENT = 0.02
"""Channels of one device share a start-up if their ratios agree to this."""
LARGEST_STARTUP_SHARE = 0.9
"""Largest share of the mean that shows a start-up."""
GRAVITY_RANGE = (8.0, 11.5)
"""Norm of the mean specific force at rest [m/s²]."""
EARTH_FIELD_RANGE_T = (20e-6, 70e-6)
"""Strength of the Earth's field [T]."""
FIELD_JUMP_RATIO = 1.3


def startups(rows: Sequence[StatisticsRow]) -> list[TableFinding]:
    """Return devices whose large channels all reach down to the same share of their mean."""
    found = []
    for dut in dict.fromkeys(r.dut for r in rows):
        parts, where = [], []
        for segment in dict.fromkeys(r.segment for r in rows if r.dut == dut):
            mine = [r for r in rows if (r.dut, r.segment) == (dut, segment) and r.large]
            shared, common = _common_share(mine)
            if len(shared) < 3:
                continue
            spread = [abs(r.std / r.mean) for r in shared]
            parts.append(
                f'in {segment} {len(shared)} of {len(mine)} large channels reach down to '
                f'{common:.3f} of their mean (σ/mean {min(spread):.3f} … {max(spread):.3f})'
            )
            where += [r.place for r in shared]
        heavy = [r for r in rows if r.dut == dut and r.quantity == 'accelerometer' and r.large]
        heavy = [r for r in heavy if abs(r.mean) * SI_FACTORS.get(r.unit, 1.0) > GRAVITY_RANGE[0]]
        shared, common = _common_share(heavy)
        if parts and len(shared) > 3:
            parts.append(
                f'the axis of gravity reaches {common:.3f} in {len(shared)} of {len(heavy)} '
                'segments'
            )
            where += [r.place for r in shared if r.place not in where]
        if parts:
            found.append(
                TableFinding(
                    'startup_transient',
                    tuple(where),
                    f'{dut}: {"; ".join(parts)}: neither temperature nor motion scales gravity '
                    'and field alike',
                    (
                        'a filter that started at zero and filled up: cut the first samples',
                        'first samples averaged with zeros',
                        'a common scale that settled (supply, reference)',
                    ),
                )
            )
    return found


def flips(rows: Sequence[StatisticsRow]) -> list[TableFinding]:
    """Return segments with gravity on another axis or of another sign than in most others."""
    found = []
    for dut in dict.fromkeys(r.dut for r in rows):
        ups = {r.segment: (r.axis, bool(r.mean > 0.0), r) for r in _gravity_axes(rows, dut)}
        kinds = [up[:2] for up in ups.values()]
        if len(set(kinds)) < 2:
            continue
        usual = max(dict.fromkeys(kinds), key=kinds.count)
        other = {segment: up for segment, up in ups.items() if up[:2] != usual}
        row = next(iter(other.values()))[2]
        how = 'changes its sign' if row.axis == usual[0] else 'is on another axis'
        found.append(
            TableFinding(
                'orientation_flip',
                tuple(up[2].place for up in other.values()),
                f'{dut} accelerometer {row.axis}: gravity {how} in {", ".join(other)} '
                f'(mean {row.mean:g} {row.unit}); elsewhere {"+" if usual[1] else "-"}{usual[0]} '
                'points up',
                (
                    'the device was remounted upside down',
                    'a sign error in the processing',
                    'the column belongs to another device',
                ),
            )
        )
    return found


def units(rows: Sequence[StatisticsRow]) -> list[TableFinding]:
    """Return quantities in a unit in which they are neither gravity nor the Earth's field."""
    found = []
    for quantity, (low, high), slack in (
        ('accelerometer', GRAVITY_RANGE, 1.0),
        ('magnetometer', EARTH_FIELD_RANGE_T, 2.0),
    ):
        for _, unit in distinct((r.quantity, r.unit) for r in rows if r.quantity == quantity):
            known = norms([r for r in rows if r.unit == unit], quantity)
            values = np.array(list(known.values())) * SI_FACTORS.get(unit, 1.0)
            if not len(values):
                continue
            middle = float(np.median(values))
            if not low / slack <= middle <= high * slack:
                found.append(_wrong_unit(quantity, unit, middle / SI_FACTORS.get(unit, 1.0)))
            elif quantity == 'magnetometer' and values.max() > values.min() * high / low:
                found.append(_no_unit(quantity, unit, values))
    return found


def field_jumps(rows: Sequence[StatisticsRow]) -> list[TableFinding]:
    """Return devices whose mean field changes its norm between segments."""
    found = []
    fields, forces = norms(rows, 'magnetometer'), norms(rows, 'accelerometer')
    for dut in dict.fromkeys(r.dut for r in rows):
        here = {segment: n for (d, segment), n in fields.items() if d == dut}
        if len(here) < 2 or max(here.values()) < FIELD_JUMP_RATIO * min(here.values()):
            continue
        force = [n for (d, _), n in forces.items() if d == dut]
        steady = (
            f' while specific force stays {min(force):.2f} … {max(force):.2f}' if force else ''
        )
        shown = ', '.join(f'{segment} {n:.3g}' for segment, n in here.items())
        found.append(
            TableFinding(
                'field_jump',
                tuple(f'{dut} magnetometer {segment}' for segment in here),
                f"{dut}: the mean field's norm changes between segments ({shown}){steady}: no "
                'temperature coefficient does that',
                (
                    'a hard-iron offset or a field that is new in each session',
                    'columns of different devices or files mixed up',
                    'the device was moved between segments',
                ),
            )
        )
    return found


def _common_share(rows: Sequence[StatisticsRow]) -> tuple[list[StatisticsRow], float]:
    """Return the rows whose extreme on the side of zero is the same share of their mean."""
    if not rows:
        return [], 1.0
    ratio = np.array([(r.low if r.mean > 0.0 else r.high) / r.mean for r in rows])
    common = float(np.median(ratio))
    if common > LARGEST_STARTUP_SHARE:
        return [], common
    near = np.abs(ratio - common) <= STARTUP_AGREEMENT
    return [r for r, ok in zip(rows, near, strict=True) if ok], common


def _gravity_axes(rows: Sequence[StatisticsRow], dut: str) -> list[StatisticsRow]:
    """Return the row of each segment whose axis carries most of gravity."""
    heavy = []
    for segment in dict.fromkeys(r.segment for r in rows if r.dut == dut):
        mine = [
            r for r in rows if (r.dut, r.segment, r.quantity) == (dut, segment, 'accelerometer')
        ]
        norm = float(np.sqrt(sum(r.mean**2 for r in mine)))
        heavy += [r for r in mine if abs(r.mean) > 0.8 * norm > 0.0]
    return heavy


def _wrong_unit(quantity: str, unit: str, norm: float) -> TableFinding:
    low, high = GRAVITY_RANGE if quantity == 'accelerometer' else EARTH_FIELD_RANGE_T
    factors = ACCELERATION_FACTORS if quantity == 'accelerometer' else FIELD_FACTORS
    fits = [u for u, factor in factors.items() if u != 'T' and low <= norm * factor <= high]
    would = f'{fits[0]} would fit' if fits else 'no common unit fits'
    what = "gravity's" if quantity == 'accelerometer' else "the Earth's field's"
    return TableFinding(
        'unit_mismatch',
        (f'{quantity} [{unit}]',),
        f'{quantity} in {unit or "no unit"}: the median norm {norm:.3g} is not {what}; {would}',
        (
            f'the unit is mislabelled: {would}',
            'a scale factor was applied twice or not at all',
            'a shielded chamber' if quantity == 'magnetometer' else 'the device was not at rest',
        ),
    )


def _no_unit(quantity: str, unit: str, values: np.ndarray) -> TableFinding:
    low, high = EARTH_FIELD_RANGE_T
    fields = {u: FIELD_FACTORS[u] * values / SI_FACTORS[unit] for u in ('nT', 'µT', 'mG', 'G')}
    inside = {u: int(((low <= field) & (field <= high)).sum()) for u, field in fields.items()}
    fits = ', '.join(f'{u} {n}' for u, n in inside.items())
    none = [u for u, n in inside.items() if n == 0]
    best = max(inside, key=lambda u: inside[u])
    return TableFinding(
        'unit_mismatch',
        (f'{quantity} [{unit}]',),
        f'{quantity}: its norms span {values.min() / SI_FACTORS[unit]:.3g} … '
        f'{values.max() / SI_FACTORS[unit]:.3g}, so no unit makes all of them the '
        f"Earth's {low * 1e6:g} … {high * 1e6:g} µT; of {len(values)} columns fit {fits}",
        (
            f'{best} is meant, and the columns outside hold a hard-iron offset or a local field',
            f'a label that fits no column ({", ".join(none)}) is a misprint',
            'columns scaled differently',
            'columns of different devices or places',
        ),
    )
