# SPDX-License-Identifier: Apache-2.0
"""A board and a driver on one bench."""

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

_PATH = Path(__file__).with_name('board_on_a_bench.py')
_SPEC = importlib.util.spec_from_file_location('board_on_a_bench', _PATH)
board_on_a_bench = importlib.util.module_from_spec(_SPEC)
sys.modules['board_on_a_bench'] = board_on_a_bench
_SPEC.loader.exec_module(board_on_a_bench)


@pytest.fixture
def bench() -> Any:
    """Class Bench."""
    return board_on_a_bench.Bench
