# SPDX-License-Identifier: Apache-2.0
"""Lines of a data logger: in any pieces, with broken sensors; column maps and port addresses."""

import pytest
from chamber_profile.reference.logger import (
    ColumnError,
    ReferenceLines,
    ReferenceLoggerPort,
    parse_columns,
)
from hypothesis import given, settings
from hypothesis import strategies as st

COLUMNS = {1: 'air', 2: 'device'}


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-90, 290), st.floats(-90, 290)), min_size=1, max_size=20),
    st.lists(st.integers(1, 30), min_size=1),
)
def test_lines_come_out_whole_however_the_bytes_are_cut(values, cuts) -> None:
    data = b''.join(f'x,{a:.3f},{b:.3f}\r\n'.encode() for a, b in values)
    lines = ReferenceLines(COLUMNS)
    readings, place, number = [], 0, 0
    while place < len(data):
        size = cuts[number % len(cuts)]
        readings += lines.feed(data[place : place + size])
        place, number = place + size, number + 1
    assert [(r['air'], r['device']) for r in readings] == [
        (round(a, 3) + 0.0, round(b, 3) + 0.0) for a, b in values
    ]


def test_a_broken_sensor_is_left_out_and_counted() -> None:
    lines = ReferenceLines(COLUMNS)
    readings = lines.feed(b'0,20.0,21.0\n1,OPEN,21.1\n2,9999,21.2\n3,20.3\nnan,nan,21.4\n')
    assert [reading.get('device') for reading in readings] == [21.0, 21.1, 21.2, None, 21.4]
    assert lines.rejected == {'air': 3, 'device': 1}


def test_the_line_that_was_under_way_is_no_reading() -> None:
    lines = ReferenceLines(COLUMNS)
    assert lines.feed(b'.5\n1,20.0,21.0\n') == [{'air': 20.0, 'device': 21.0}]
    assert lines.rejected == {}


@pytest.mark.parametrize(
    'entries', [[], ['air'], ['x=air'], ['1='], ['1=a', '1=b'], ['1=a', '2=a']]
)
def test_a_column_map_that_maps_nothing_is_refused(entries) -> None:
    with pytest.raises(ColumnError, match='columns'):
        parse_columns(entries)


def test_a_port_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match='tcp://HOST:PORT'):
        ReferenceLoggerPort('/dev/ttyUSB0', 9600)
