# SPDX-License-Identifier: Apache-2.0
"""YAML nested without end is refused before a loader's stack overflows."""

import pytest
import yaml
from imu_recording.deep_yaml import DEEPEST_NESTING, refuse_deep_yaml


@pytest.mark.parametrize('bracket', ['[]', '{}'])
def test_the_deepest_is_taken_and_one_more_is_not(bracket: str) -> None:
    def nested(depth: int) -> str:
        inner = '' if bracket == '[]' else 'a: '
        return (bracket[0] + inner) * (depth - 1) + bracket + bracket[1] * (depth - 1)

    refuse_deep_yaml(nested(DEEPEST_NESTING))
    with pytest.raises(yaml.YAMLError, match='more than 200 deep'):
        refuse_deep_yaml(nested(DEEPEST_NESTING + 1))


def test_so_many_beside_each_other_are_no_depth() -> None:
    refuse_deep_yaml(f'[{", ".join(["[1]"] * 10 * DEEPEST_NESTING)}]')


def test_a_hundred_thousand_take_no_stack() -> None:
    with pytest.raises(yaml.YAMLError):
        refuse_deep_yaml('[' * 100_000)
