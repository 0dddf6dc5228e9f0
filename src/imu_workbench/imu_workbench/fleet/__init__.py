# SPDX-License-Identifier: Apache-2.0
"""Many devices: an engine over their bags, what they share, which are odd, how short is enough."""

from __future__ import annotations

from importlib.util import find_spec

from imu_recording.user_error import UserError

LIBRARIES = ('dask', 'distributed', 'pyarrow', 'duckdb', 'fsspec', 'sklearn')


def require_fleet(libraries: tuple[str, ...] = LIBRARIES) -> None:
    """Raise UserError that names what is missing and the command that installs it."""
    missing = [name for name in libraries if find_spec(name) is None]
    if missing:
        raise UserError(
            f'work on a fleet needs {", ".join(missing)}: '
            'python -m pip install -r requirements-fleet.txt'
        )
