# SPDX-License-Identifier: Apache-2.0
"""Parameters accept what they can mean and name what they cannot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest
from imu_recording.ros.parameter import ParameterError, config_from_values, parameter


@dataclass(frozen=True)
class Config:
    rate_hz: float = parameter(100.0, 'Rate', unit='Hz', bounds=(0.1, 1000.0))
    depth: int = parameter(5, 'Depth', bounds=(1, 10))
    preset: str = parameter('calm', 'Preset', choices=('calm', 'brisk'))
    start: bool = parameter(False, 'Start')
    names: list[str] = parameter([], 'Names')  # noqa: RUF009
    weights: list[float] = parameter([1.0], 'Weights', bounds=(0.0, 2.0))  # noqa: RUF009


def test_numbers_accept_integers_and_whole_floats() -> None:
    config = config_from_values(Config, {'rate_hz': 50, 'depth': 7.0, 'weights': [1, 0.5]})
    assert config == Config(rate_hz=50.0, depth=7, weights=[1.0, 0.5])
    assert isinstance(config.rate_hz, float)
    assert isinstance(config.depth, int)


def test_an_empty_list_comes_as_nothing() -> None:
    assert config_from_values(Config, {'names': None, 'weights': None}).weights == []


def test_defaults_are_not_shared() -> None:
    first, second = Config(), Config()
    first.names.append('x')
    assert second.names == []


@pytest.mark.parametrize(
    ('name', 'value', 'said'),
    [
        ('rate_hz', 0, 'rate_hz is 0, expected 0.1 … 1000 Hz'),
        ('rate_hz', float('nan'), 'rate_hz is nan, expected'),
        ('rate_hz', 'fast', "rate_hz is 'fast', expected a number"),
        ('rate_hz', True, 'rate_hz is True'),
        ('depth', 2.5, 'depth is 2.5, expected a whole number'),
        ('preset', 'wild', "preset is 'wild', expected one of calm, brisk"),
        ('start', 1, 'start is 1, expected true or false'),
        ('weights', [1.0, 3.0], 'weights is 3, expected 0 … 2'),
        ('weights', 'heavy', "weights is 'heavy', expected a list"),
        ('names', [1, 2], 'names is 1, expected a text'),
        ('speed', 1, 'unknown parameter speed; known: depth,'),
    ],
)
def test_what_is_refused(name: str, value: Any, said: str) -> None:
    with pytest.raises(ParameterError) as raised:
        config_from_values(Config, {name: value})
    assert str(raised.value).startswith(said)
