# SPDX-License-Identifier: Apache-2.0
"""Tables are judged by their own numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_workbench.tables.check import StatisticsRow, TableError, check_rows, read_table

SOUND = StatisticsRow(
    dut='A',
    quantity='accelerometer',
    unit='m/s^2',
    axis='x',
    segment='R1',
    low=9.7,
    high=9.9,
    mean=9.8,
    std=0.03,
)
MICROTESLA = {'uT': 1.0, 'µT': 1.0, 'T': 1e-6, 'G': 1e-2, 'mG': 10.0, 'nT': 1e3}


def made_up(
    seed: int, *, devices: int = 3, segments: int = 5, unit: str = 'uT', offset: float = 0.0
) -> list[StatisticsRow]:
    """Return the statistics of drawn samples: gravity on one axis, a field of 25 … 65 µT."""
    rng = np.random.default_rng(seed)
    rows = []
    for d in range(devices):
        field = rng.normal(0.0, 1.0, 3)
        field *= rng.uniform(25.0, 65.0) / np.linalg.norm(field)
        for segment in range(segments):
            truth = {
                'gyroscope [deg/s]': (rng.normal(0.0, 0.5, 3), 0.03, 2),
                'accelerometer [m/s^2]': (9.81 * np.eye(3)[d % 3], 0.1, 2),
                f'magnetometer [{unit}]': (field * MICROTESLA[unit] + offset, 0.01 * 45, None),
            }
            for quantity, (level, spread, digits) in truth.items():
                spread = spread if digits else spread * MICROTESLA[unit]  # noqa: PLW2901
                for axis in range(3):
                    x = level[axis] + rng.normal(0.0, spread, 500)
                    shown = [
                        float(f'{v:.4g}') if digits is None else round(v, digits)
                        for v in (x.min(), x.max(), x.mean(), x.std())
                    ]
                    name, _, label = quantity.partition(' ')
                    rows.append(
                        StatisticsRow(
                            f'D{d}', name, label.strip('[]'), 'xyz'[axis], f'R{segment}', *shown
                        )
                    )
    return rows


@pytest.mark.shared_data
def test_the_published_tables_give_themselves_away(shared: Path) -> None:
    findings = check_rows(read_table(shared / 'reference' / 'tables_3_4_5.csv'))
    found = {(f.name, place) for f in findings for place in f.where}
    assert ('impossible_statistic', 'DUT1 magnetometer z R4') in found
    assert ('impossible_statistic', 'DUT2 gyroscope z reference') in found
    assert ('spikes', 'DUT1 gyroscope x R4') in found
    assert ('orientation_flip', 'DUT2 accelerometer y R4') in found
    assert ('startup_transient', 'DUT3 accelerometer z R4') in found
    for one, other in (('DUT2', 'DUT3'), ('DUT3', 'DUT2')):
        assert ('repeated_columns', f'{one} gyroscope R1') in found, other
    assert ('repeated_columns', 'DUT1 gyroscope R2') in found
    names = {name for name, _ in found}
    assert {'startup_transient', 'unit_mismatch', 'field_jump', 'repeated_columns'} <= names
    assert any('44 σ' in f.text for f in findings)
    assert all(len(f.explanations) >= 2 for f in findings)


@pytest.mark.parametrize('unit', MICROTESLA)
@pytest.mark.parametrize('seed', range(4))
def test_sane_tables_are_left_alone_in_any_unit(seed: int, unit: str) -> None:
    assert check_rows(made_up(seed, unit=unit)) == []


def test_a_constant_hard_iron_offset_is_no_wrong_unit() -> None:
    assert check_rows(made_up(7, offset=40.0)) == []


@pytest.mark.parametrize(
    ('quantity', 'label', 'would'),
    [('magnetometer', 'nT', 'uT would fit'), ('accelerometer', 'g', 'm/s^2 would fit')],
)
def test_a_label_that_cannot_be_names_the_one_that_could(
    quantity: str, label: str, would: str
) -> None:
    rows = [replace(r, unit=label) if r.quantity == quantity else r for r in made_up(1)]
    found = [f for f in check_rows(rows) if f.name == 'unit_mismatch']
    assert [f.where for f in found] == [(f'{quantity} [{label}]',)]
    assert would in found[0].text


def test_a_sound_row_is_left_alone_and_an_impossible_one_is_not() -> None:
    assert check_rows([SOUND]) == []
    assert check_rows([replace(SOUND, mean=9.95)])[0].name == 'impossible_statistic'
    assert check_rows([replace(SOUND, std=0.25)])[0].name == 'impossible_statistic'
    assert check_rows([replace(SOUND, low=9.9, high=9.7)])[0].name == 'impossible_statistic'


def test_impossible_numbers_are_found_in_tesla_as_well() -> None:
    tiny = StatisticsRow(
        dut='A',
        quantity='magnetometer',
        unit='T',
        axis='x',
        segment='R1',
        low=1.1e-5,
        high=1.3e-5,
        mean=1.2e-5,
        std=9e-6,
    )
    assert [f.name for f in check_rows([tiny])] == ['impossible_statistic']


def test_each_break_of_a_sane_table_is_named_alone() -> None:
    sane = made_up(3)

    def broken(kind: str) -> list[StatisticsRow]:
        changed = []
        for r in sane:
            place, row = (r.dut, r.quantity, r.segment), r
            if kind == 'orientation_flip' and place == ('D1', 'accelerometer', 'R2'):
                row = replace(r, low=-r.high, high=-r.low, mean=-r.mean)
            if kind == 'spikes' and (*place, r.axis) == ('D0', 'gyroscope', 'R1', 'x'):
                row = replace(r, low=r.mean - 2.0)
            if kind == 'field_jump' and place == ('D2', 'magnetometer', 'R3'):
                row = replace(r, low=1.5 * r.low, high=1.5 * r.high, mean=1.5 * r.mean)
                row = replace(row, low=min(row.low, row.mean), high=max(row.high, row.mean))
            if kind == 'repeated_columns' and place == ('D2', 'gyroscope', 'R0'):
                twin = ('D0', 'gyroscope', r.axis, 'R4')
                row = next(o for o in sane if (o.dut, o.quantity, o.axis, o.segment) == twin)
                row = replace(row, dut='D2', segment='R0')
            if kind == 'startup_transient' and r.dut == 'D0' and r.large:
                end = 0.54 * r.mean
                row = replace(r, low=min(r.low, end), high=max(r.high, end))
            changed.append(row)
        return changed

    for kind in (
        'orientation_flip', 'spikes', 'field_jump', 'repeated_columns', 'startup_transient',
    ):  # fmt: skip
        assert {f.name for f in check_rows(broken(kind))} == {kind}


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('dut,axis\nA,x\n', 'quantity'),
        ('', 'no rows'),
        ('dut,quantity,axis,segment,min,max,mean,std\nA,gyroscope,x,R,1,2,,0\n', 'numbers'),
        ('dut,quantity,axis,segment,min,max,mean,std\nA,gyroscope,x,R,1,2,nan,0\n', 'finite'),
    ],
)
def test_a_table_that_cannot_be_read_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / 'table.csv'
    path.write_text(text)
    with pytest.raises(TableError, match=complaint):
        read_table(path)
