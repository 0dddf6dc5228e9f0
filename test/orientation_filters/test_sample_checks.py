# SPDX-License-Identifier: Apache-2.0
"""Samples are flagged by time and value, and say which of their parts are usable."""

from __future__ import annotations

from math import inf, nan

import pytest
from orientation_filters.result import flag_names
from orientation_filters.sample_checks import Sample, SampleParams, check_sample

SECOND = 1_000_000_000
RATE, FORCE, FIELD = (0.1, 0.0, 0.0), (0.0, 0.0, 9.81), (2e-5, 0.0, -4e-5)
NONE = (nan, nan, nan)
PARAMS = SampleParams(use_magnetometer=True, max_gap=SECOND, magnetometer_timeout=SECOND // 2)
LAST = 10 * SECOND
NEXT = LAST + SECOND // 100


@pytest.mark.parametrize(
    ('sample', 'names'),
    [
        (Sample(NEXT, RATE, FORCE, FIELD), ()),
        (Sample(NEXT, RATE, FORCE, NONE), ()),
        (Sample(LAST + SECOND, RATE, FORCE, NONE), ('six_axis',)),
        (Sample(LAST, RATE, FORCE, FIELD), ('dropped',)),
        (Sample(LAST - SECOND // 2, RATE, FORCE, FIELD), ('dropped',)),
        (Sample(LAST + 2 * SECOND, RATE, FORCE, FIELD), ('reinitialised',)),
        (Sample(LAST - 2 * SECOND, RATE, FORCE, FIELD), ('reinitialised', 'jumped_back')),
        (Sample(NEXT, (nan, 0.0, 0.0), FORCE, FIELD), ('dropped', 'invalid_gyroscope')),
        (Sample(NEXT, (2e3, 0.0, 0.0), FORCE, FIELD), ('dropped', 'invalid_gyroscope')),
        (Sample(NEXT, RATE, (0.0, 0.0, 0.0), FIELD), ('invalid_accelerometer',)),
        (Sample(NEXT, RATE, (0.0, inf, 0.0), FIELD), ('invalid_accelerometer',)),
        (Sample(NEXT, RATE, FORCE, (0.0, 0.0, 0.0)), ('invalid_magnetometer',)),
        (Sample(NEXT, RATE, FORCE, (2e-5, nan, 0.0)), ('invalid_magnetometer',)),
    ],
)
def test_flags(sample: Sample, names: tuple[str, ...]) -> None:
    checked, flags = check_sample(sample, LAST, LAST, PARAMS)
    assert flag_names(flags) == names
    assert checked.has_force == ('invalid_accelerometer' not in names)
    assert checked.has_field == (sample.magnetic_field == FIELD)
    assert checked.interval == pytest.approx((sample.stamp - LAST) * 1e-9)


def test_the_first_sample_and_the_first_field_set_the_attitude() -> None:
    first = Sample(NEXT, RATE, FORCE, NONE)
    assert flag_names(check_sample(first, -1, -1, PARAMS)[1]) == ('reinitialised', 'six_axis')
    with_field = first._replace(magnetic_field=FIELD)
    assert flag_names(check_sample(with_field, LAST, -1, PARAMS)[1]) == ('reinitialised',)
    broken = first._replace(angular_velocity=(nan, nan, nan))
    names = flag_names(check_sample(broken, -1, -1, PARAMS)[1])
    assert set(names) >= {'not_started', 'dropped', 'invalid_gyroscope'}


def test_a_magnetometer_that_is_not_used_is_absent() -> None:
    alone = PARAMS._replace(use_magnetometer=False)
    checked, flags = check_sample(Sample(NEXT, RATE, FORCE, FIELD), LAST, -1, alone)
    assert not checked.has_field
    assert flag_names(flags) == ('six_axis',)
