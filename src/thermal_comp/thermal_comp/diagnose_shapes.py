# SPDX-License-Identifier: Apache-2.0
"""A form with one of its shape parameters moved."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

from thermal_comp.diagnose_bank import ColumnBank, Term
from thermal_comp.diagnose_candidates import SEARCHED, Form
from thermal_comp.effects.effect import Effect

STEP_TIME_S = 400.0
"""A factor of 1.25 moves a step in time by this [s]."""
LINE_HZ = 2e-5
"""A factor of 1.25 moves a line by this [Hz]."""


def moved_forms(bank: ColumnBank, form: Form, ratio: float) -> list[Form]:
    """Return the form with each shape parameter moved up and down, within its bounds."""
    effects = list(_moved(form.effect, ratio))
    terms = bank.terms(effects)
    single = len(form.terms) == 1 and len(form.terms[0].columns) < len(terms[0].columns)
    if single:
        first = bank.term(form.effect).columns.index(form.terms[0].columns[0])
        terms = [Term((term.columns[first],)) for term in terms]
    return [Form(e, (t,), form.free) for e, t in zip(effects, terms, strict=True)]


def _moved(effect: Effect, ratio: float) -> Iterator[Effect]:
    for item in fields(effect):
        value: Any = getattr(effect, item.name)
        low, high = SEARCHED.get((effect.name, item.name), item.metadata['bounds'])
        if item.metadata['unit'] == '1':
            continue
        several = isinstance(value, tuple)
        values = value if several else (value,)
        for k, number in enumerate(values):
            for moved in _steps(item.name, float(number), ratio):
                if low <= moved <= high:
                    new = (*values[:k], moved, *values[k + 1 :])
                    yield replace(effect, **{item.name: new if several else moved})


def _steps(name: str, number: float, ratio: float) -> tuple[float, float]:
    share = (ratio - 1.0) / 0.25
    if name == 'step_time':
        return number + STEP_TIME_S * share, number - STEP_TIME_S * share
    if name == 'frequency':
        return number + LINE_HZ * share, number - LINE_HZ * share
    return number * ratio, number / ratio
