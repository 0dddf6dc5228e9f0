# SPDX-License-Identifier: Apache-2.0
"""A model from plain values: the same model back, and every field refused by its dotted name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from thermal_comp.model.document import Field, model_from_document
from thermal_comp.model.values import ModelError

from ..models import line_model


def test_plain_values_give_the_model_they_were_made_from() -> None:
    document = line_model().to_dict()
    assert model_from_document(document).to_dict() == document


def test_noise_that_grows_with_vibration_comes_back() -> None:
    model = line_model()
    part = model.sensors['accelerometer']
    assert part.noise is not None
    noise = replace(part.noise, per_vibration=np.array([1e-4, 0.0, 2e-4]), still_vibration=1e-3)
    shaken = replace(part, noise=noise)
    document = replace(model, sensors={**model.sensors, 'accelerometer': shaken}).to_dict()
    assert model_from_document(document).to_dict() == document
    entry = document['sensors']['accelerometer']['noise']
    entry['per_vibration']['value'][0] = -1.0
    with pytest.raises(ModelError, match=r'accelerometer\.noise\.per_vibration: .*negative'):
        model_from_document(document)


def test_the_axes_weighed_without_slow_noise_come_back() -> None:
    model = line_model()
    part = model.sensors['accelerometer']
    assert part.noise is not None
    weighed = replace(part, noise=replace(part.noise, white_weights=(True, False, True)))
    document = replace(model, sensors={**model.sensors, 'accelerometer': weighed}).to_dict()
    read = model_from_document(document).sensors['accelerometer'].noise
    assert read is not None
    assert read.white_weights == (True, False, True)
    for wrong in ([True, False], [1, 0, 1], True):
        document['sensors']['accelerometer']['noise']['white_weights'] = wrong
        with pytest.raises(ModelError, match=r'accelerometer\.noise\.white_weights'):
            model_from_document(document)


@pytest.mark.parametrize(
    ('read', 'message'),
    [
        (lambda f: f['a']['b'], 'a.b: missing'),
        (lambda f: f['list'].mapping(), r'list: is \[1, 2\], expected a mapping'),
        (lambda f: f['a'].items(), r'a: is {}, expected a list'),
        (lambda f: f['list'].items()[1].text(), r'list\[1\]: is 2, expected text'),
        (lambda f: f['list'].flag(), r'list: is \[1, 2\], expected true or false'),
        (lambda f: f['yes'].number(), 'yes: True is no number'),
        (lambda f: f['huge'].number(), 'huge: is inf, expected a finite number'),
        (lambda f: f['list'].array(3), r'list: has shape \(2,\), expected 3'),
        (lambda f: f['list'].array(None, 3), r'list: has shape \(2,\), expected any × 3'),
        (lambda f: f['ragged'].array(None, None), 'ragged: has rows of different lengths'),
        (lambda f: f.only('a', 'list'), 'yes: no such field; there are a, list'),
        (lambda f: f['long'].flag(), "long: is 'x{36}…, expected true or false"),
    ],
)
def test_a_field_is_refused_by_its_name(read: Callable[[Field], Any], message: str) -> None:
    values = {
        'a': {},
        'list': [1, 2],
        'yes': True,
        'huge': '1e999',
        'ragged': [[1], [1, 2]],
        'long': 'x' * 100,
    }
    with pytest.raises(ModelError, match=f'^{message}$'):
        read(Field(values))


def test_numbers_may_be_text_as_yaml_leaves_them() -> None:
    np.testing.assert_array_equal(Field([['1e-5', 2]]).array(1, 2), [[1e-5, 2.0]])
    assert Field({}).get('absent', 4.0).number() == 4.0
