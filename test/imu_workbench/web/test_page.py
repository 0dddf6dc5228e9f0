# SPDX-License-Identifier: Apache-2.0
"""What the page saves and says: the zip of a case, the change that was asked for, its runs."""

from __future__ import annotations

import zipfile
from pathlib import Path
from types import SimpleNamespace

from imu_workbench.web.case.tasks import Change
from imu_workbench.web.page import change_of, runs_summary, zipped


def test_the_zip_of_a_case_has_its_files_and_none_of_the_process(tmp_path: Path) -> None:
    case = tmp_path / 'dut1'
    (case / 'versions').mkdir(parents=True)
    (case / 'case.yaml').write_text('schema: 1\n')
    (case / 'versions' / 'v1.yaml').write_text('model')
    (case / '.lock').write_text('')
    target = tmp_path / 'zip'
    with zipfile.ZipFile(zipped(case, target)) as archive:
        files = {name for name in archive.namelist() if not name.endswith('/')}
        assert files == {'dut1/case.yaml', 'dut1/versions/v1.yaml'}
        assert archive.read('dut1/versions/v1.yaml') == b'model'


def test_sensors_are_named_in_the_order_of_the_tables_and_unknown_ones_left_out() -> None:
    asked = change_of('thermal_lag', ('magnetometer', 'gyroscope', 'all'), added=True)
    assert asked == Change('thermal_lag', ('gyroscope', 'magnetometer'), added=True)


def test_runs_are_counted_with_their_samples() -> None:
    bags = [SimpleNamespace(samples=samples) for samples in (1200, 34)]
    assert runs_summary(bags) == '2 runs · 1\N{NARROW NO-BREAK SPACE}234 samples'
    assert runs_summary(bags[1:]) == '1 run · 34 samples'
