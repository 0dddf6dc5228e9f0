# SPDX-License-Identifier: Apache-2.0
"""Tasks give the same results in forked processes; what goes wrong in one is raised."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass

import pytest

from imu_workbench import parallel


@dataclass(frozen=True)
class Square:
    """A number to be squared; negative ones fail."""

    number: int
    label = 'squaring'
    size = 1.0

    def run(self) -> tuple[int, int]:
        if self.number < 0:
            raise ValueError(f'{self.number} is negative')
        return self.number**2, os.getpid()


@pytest.fixture
def forking(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, 'may_fork', lambda: True)


@pytest.mark.parametrize('workers', [1, 2])
def test_results_come_in_the_order_of_the_tasks(forking: None, workers: int) -> None:
    found = parallel.run_tasks([Square(n) for n in range(4)], workers)
    assert [square for square, _ in found] == [0, 1, 4, 9]


def test_a_started_task_runs_in_a_process_of_its_own(forking: None) -> None:
    square, process = parallel.start_task(Square(3), 2)()
    assert square == 9
    assert process != os.getpid()
    assert parallel.start_task(Square(3), 1)() == (9, os.getpid())


def test_what_goes_wrong_in_a_started_task_is_raised(forking: None) -> None:
    result = parallel.start_task(Square(-1), 2)
    with pytest.raises(ValueError, match='-1 is negative'):
        result()


def test_a_process_that_has_fitted_noise_shares_its_work() -> None:
    """Threads of a library's own, of which `may_fork` knows nothing, leave it all to one core."""
    program = (
        'from thermal_comp.noise.process import toeplitz_product as product; import numpy as np; '
        'product(np.ones(64), np.arange(64), np.ones((64, 1))); '
        'from imu_workbench.parallel import may_fork; print(may_fork())'
    )
    plain = {k: v for k, v in os.environ.items() if not k.endswith('_NUM_THREADS')}
    process = subprocess.run([sys.executable, '-c', program], env=plain, check=True, stdout=-1)
    assert process.stdout == b'True\n'
