# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings are true."""

import doctest
from importlib import import_module

import pytest

MODULES = ['bag_topics', 'cdr_layout', 'parameter', 'phase', 'recorder_settings', 'up_axis']


@pytest.mark.parametrize('name', MODULES)
def test_examples(name: str) -> None:
    result = doctest.testmod(import_module(f'imu_recording.{name}'))
    assert result.attempted
    assert not result.failed
