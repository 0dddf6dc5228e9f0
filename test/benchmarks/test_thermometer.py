# SPDX-License-Identifier: Apache-2.0
"""A few of the recordings of benchmarks/thermometer.py: every fault found, none invented."""

import pytest
from thermometer import DAMAGE, measure


@pytest.mark.long
def test_every_fault_is_found_and_none_in_sound_recordings() -> None:
    found, false, disturbed = measure(6)
    assert found == dict.fromkeys(DAMAGE, 6)
    assert not false
    assert disturbed == 0
