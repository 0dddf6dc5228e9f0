# SPDX-License-Identifier: Apache-2.0
"""State of a filter between samples that come one by one, kept in compiled memory.

Passing a state of 170 numbers to the kernel and back as Python tuples takes ten times as long as
the update itself; here only samples and estimates pass.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

from imu_recording.jit import entry_of
from numba.typed import List

from orientation_filters.kernel import kernel
from orientation_filters.result import Estimate
from orientation_filters.sample_checks import Sample


@kernel
def hold(value: Any) -> Any:
    """Return a list in compiled memory that holds the value alone."""
    holder = List()
    holder.append(value)
    return holder


@kernel
def held(holder: Any) -> Any:
    """Return the value of a holder as Python's tuples."""
    return holder[0]


class CompiledState:
    """State and parameters of a filter module that has a `step`."""

    def __init__(self, module: ModuleType, params: Any) -> None:
        self._kernel = module.step
        self._step: Callable[..., Any] = self._first_step
        self._states = hold(module.initial_state())
        self.set_params(params)

    def _first_step(self, *arguments: Any) -> Any:
        found = self._kernel(*arguments)
        self._step = entry_of(self._kernel, arguments)
        return found

    def set_params(self, params: Any) -> None:
        """Take over parameters; the state goes on."""
        self._params = hold(params)

    def update(self, sample: Sample) -> Estimate:
        """Return the estimate after a sample."""
        return Estimate(*self._step(self._states, self._params, *sample))

    @property
    def state(self) -> Any:
        """The module's State."""
        return held(self._states)


class PlainState:
    """State and parameters of a filter module in plain Python."""

    def __init__(self, module: ModuleType, params: Any) -> None:
        self._update = module.update
        self.state = module.initial_state()
        self._params = params

    def set_params(self, params: Any) -> None:
        """Take over parameters; the state goes on."""
        self._params = params

    def update(self, sample: Sample) -> Estimate:
        """Return the estimate after a sample."""
        found: Estimate
        self.state, found = self._update(self.state, self._params, sample)
        return found


def live_state(module: ModuleType, params: Any) -> CompiledState | PlainState:
    """Return the state of a filter module before its first sample."""
    return (CompiledState if hasattr(module, 'step') else PlainState)(module, params)
