# SPDX-License-Identifier: Apache-2.0
"""Compile every module and kernel of the workspace: python -m imu_workbench.precompile.

The set-up runs it, so that no command and no node compiles when a user starts it. Python keeps
the bytecode of what it imports, of libraries as well, unless PYTHONDONTWRITEBYTECODE forbids it.
"""

from __future__ import annotations

import gc
import os
import pkgutil
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module

import numpy as np
import thermal_comp.precompile
from imu_driver.emulator.transport import SimulatedTransport
from imu_recording.logs.ulog_stream import KNOWN_KINDS, scan_messages
from orientation_filters.filters import FILTERS
from orientation_filters.precompile import precompile as precompile_filters

from imu_workbench.__main__ import OWN_PACKAGES
from imu_workbench.parallel import run_tasks
from imu_workbench.simulate.campaign import Logging, simulate_run


@dataclass(frozen=True)
class Compilation:
    """The kernels of one part."""

    label: str
    size: float
    compile: Callable[[], object]

    def run(self) -> None:
        """Compile; collect garbage once, at the end: numba keeps most of what it makes."""
        gc.disable()
        self.compile()
        gc.enable()
        gc.collect()


def import_modules() -> None:
    """Import every module of the workspace whose libraries are installed."""
    for name in OWN_PACKAGES:
        package = import_module(name)
        for module in pkgutil.walk_packages(package.__path__, f'{name}.'):
            if not module.name.endswith('__main__'):
                with suppress(ImportError):  # an extra that is not installed
                    import_module(module.name)


def precompile_simulation() -> None:
    """Run the simulated chamber and device once, recorded and live."""
    simulate_run('short_20min', 'dut1', Logging(10.0), seed=1)
    simulate_run('short_20min', 'dut1', Logging(1.0, mean=True), seed=1)
    SimulatedTransport.from_url('simulated://dut1').read()


def precompile_logs() -> None:
    """Go through a log without messages."""
    table = np.zeros(1, np.int64)
    scan_messages(np.frombuffer(b'', np.uint8), 0, table, KNOWN_KINDS, table, table)


def main() -> int:
    """Compile."""
    parts = (
        *(Compilation(name, 3.0, partial(precompile_filters, [name])) for name in FILTERS),
        Compilation('simulated chamber and device', 2.0, precompile_simulation),
        Compilation('logs', 0.1, precompile_logs),
        Compilation('thermal model and bags', 1.0, thermal_comp.precompile.precompile),
        Compilation('modules', 1.5, import_modules),
    )
    run_tasks(parts, os.cpu_count() or 1)
    return 0


if __name__ == '__main__':
    sys.exit(main())
