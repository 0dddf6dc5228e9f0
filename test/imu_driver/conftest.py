# SPDX-License-Identifier: Apache-2.0
"""The emulation of board, line and session, for the tests of this folder."""

import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def emulation() -> Any:
    """Class Emulation."""
    from emulation import Emulation

    return Emulation
