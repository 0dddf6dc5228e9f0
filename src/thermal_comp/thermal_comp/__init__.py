# SPDX-License-Identifier: Apache-2.0
"""Finds, explains and removes the temperature error of nine-axis MEMS IMUs.

From bags to a better model and a picture of the error it removes:

>>> import thermal_comp as tc
>>> recordings = tc.read('bags/hidden_effect_?')
>>> found = tc.diagnose(recordings)
>>> found.verdict, found.findings[0].name, found.findings[0].sensor
('missing', 'thermal_lag', 'accelerometer')
>>> better = tc.add(recordings, found)
>>> bool(better.steps[0].error_after < 0.2 * better.steps[0].error_before)
True
>>> picture = better.plot()

Results print as text, show as tables in a notebook, and have `to_dict()` and `plot()`; so has each
recording of `read`, but for `plot()`. The parts of these functions are in the subpackages:
`effects`, `data`, `noise`, `linear`, `fitting`, `comparison`, `diagnosis`, `experiment`, `model`,
`compensation`, `still`, `presentation`.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from thermal_comp.workflow import (
        add,
        compare,
        compensate,
        diagnose,
        fit,
        load,
        read,
        save,
    )

# Before numpy is loaded: on small matrices OpenBLAS threads wait longer for a core than they work.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
# The first transform of scipy.fft starts a thread per core, which never work: nothing asks for it.
os.environ.setdefault('DUCC0_NUM_THREADS', '1')

__all__ = ['add', 'compare', 'compensate', 'diagnose', 'fit', 'load', 'read', 'save']


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module('thermal_comp.workflow'), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
