# SPDX-License-Identifier: Apache-2.0
"""Results of functions of prepared runs, kept as long as the runs.

A model is fitted and compared before and after each effect that is added to it: most of what such
a step computes of the runs, the step before has computed.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, Concatenate, cast
from weakref import WeakKeyDictionary, ref

import numpy as np

from thermal_comp.data.prepared_run import PreparedRun


def kept[**P, T](
    function: Callable[Concatenate[Sequence[PreparedRun], P], T],
) -> Callable[Concatenate[Sequence[PreparedRun], P], T]:
    """Return the function with its results kept: for equal runs and arguments it computes once.

    Runs are equal while their block means are: draws of noise may be written into them. Arguments
    are sensors, effects and noise, alone or in lists and mappings. Callers must not change a
    result.
    """
    results: WeakKeyDictionary[PreparedRun, dict[Hashable, Any]] = WeakKeyDictionary()

    @wraps(function)
    def looked_up(runs: Sequence[PreparedRun], /, *args: P.args, **kwargs: P.kwargs) -> T:
        if not runs:
            return function(runs, *args, **kwargs)
        known = results.setdefault(runs[0], {})
        measured = [hash(values.tobytes()) for run in runs for values in run.measured.values()]
        key = (tuple(map(ref, runs)), tuple(measured), _hashable(args), _hashable(kwargs))
        if key not in known:
            known[key] = function(runs, *args, **kwargs)
        return cast('T', known[key])

    return looked_up


def _hashable(value: Any) -> Hashable:
    """Return what tells arguments apart: of those compared by identity what they hold."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, Mapping):
        return tuple((key, _hashable(each)) for key, each in value.items())
    if isinstance(value, list | tuple):
        return tuple(map(_hashable, value))
    if is_dataclass(value) and type(value).__hash__ is object.__hash__:
        return tuple(_hashable(getattr(value, field.name)) for field in fields(value))
    return cast('Hashable', value)
