# SPDX-License-Identifier: Apache-2.0
"""What made a result: versions of package and libraries, the command."""

from __future__ import annotations

import platform
import shlex
import sys
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ('imu_workbench', 'numpy', 'scipy', 'numba', 'rosbags', 'plotly')


def versions() -> dict[str, str]:
    """Return the versions of Python, this package and the libraries that compute."""
    found = {'Python': platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = 'not installed'
    return found


def command_line() -> str:
    """Return the command that is running, as one types it."""
    return shlex.join(['python', '-m', 'imu_workbench', *sys.argv[1:]])
