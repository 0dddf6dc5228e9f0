# SPDX-License-Identifier: Apache-2.0
"""explain: every effect and every finding with all that is known about it."""

from pathlib import Path

import pytest
from thermal_comp.diagnosis.explanations import FINDINGS
from thermal_comp.effects import EFFECTS

from .asking import Answer, refuses


@pytest.mark.parametrize('name', sorted(EFFECTS))
def test_every_effect_is_explained_with_all_it_has(name: str, answer: Answer) -> None:
    code, content, text = answer('explain', name)
    assert code == 0
    effect = EFFECTS[name]
    for part in (effect.equation, effect.separation, effect.typical_size, effect.reference):
        assert part
        assert part.split()[0] in text
    for parameter in effect().shape_parameters:
        assert parameter in text
        low, high = content['parameters'][parameter]['bounds']
        assert low < high
    for channel in effect.channels:
        assert channel in text


@pytest.mark.parametrize('name', sorted(FINDINGS))
def test_every_finding_without_columns_is_explained_too(name: str, answer: Answer) -> None:
    code, content, text = answer('explain', name)
    assert code == 0
    assert content['kind'] in {'clock', 'effect', 'noise', 'data_quality'}
    assert name not in EFFECTS
    for part in (content['seen'], content['separation'], content['remedy']):
        assert part in text


def test_the_catalogue_goes_to_a_file(tmp_path: Path, answer: Answer) -> None:
    target = tmp_path / 'physics.md'
    code, content, _ = answer('explain', '--all', '-o', target)
    assert code == 0
    assert set(content) == set(EFFECTS)
    written = target.read_text()
    assert all(name in written for name in EFFECTS)
    assert "'magic' is no effect, finding or word" in refuses(answer, 'explain', 'magic')
