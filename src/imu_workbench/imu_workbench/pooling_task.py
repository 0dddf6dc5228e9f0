# SPDX-License-Identifier: Apache-2.0
"""One model for all devices beside one for each, as a task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from thermal_comp.model import ModelError, ThermalModel
from thermal_comp.pooling import PoolingTest, examine_prepared
from thermal_comp.prepared_run import PreparedRun


@dataclass(frozen=True, eq=False)
class PoolingTask:
    """The runs of several devices and their linear models, where these are fitted already."""

    runs: Sequence[PreparedRun]
    models: Mapping[str, ThermalModel]

    @property
    def label(self) -> str:
        """What is fitted."""
        return 'fitting all devices together'

    @property
    def size(self) -> float:
        """About as long as a filter run over two hours."""
        return 0.5

    def run(self) -> Mapping[str, PoolingTest]:
        """Return the test per sensor; none for one device, or where it cannot be fitted."""
        if len({run.device for run in self.runs}) < 2:
            return {}
        try:
            return examine_prepared(self.runs, self.models)[1]
        except ModelError:
            return {}
