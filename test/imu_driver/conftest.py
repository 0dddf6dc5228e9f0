# SPDX-License-Identifier: Apache-2.0
"""The test bench of board and session, for the tests of this folder."""

import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def bench() -> Any:
    """Class Bench."""
    from bench import Bench

    return Bench
