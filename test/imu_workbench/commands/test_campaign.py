# SPDX-License-Identifier: Apache-2.0
"""campaign: nothing is written into a folder in use, and odd options are refused."""

import pytest
from imu_workbench.__main__ import main


def test_a_campaign_does_not_write_into_a_folder_in_use(tmp_path, capsys) -> None:
    (tmp_path / 'x').mkdir()
    (tmp_path / 'x' / 'mine').write_text('mine')
    assert main(['campaign', 'short_20min', '-o', str(tmp_path)]) == 2
    assert 'not empty' in capsys.readouterr().err


@pytest.mark.parametrize(
    'options', [['--devices', '4'], ['--imu-rate', '0.3'], ['--time-scale', 'fast']]
)
def test_options_that_make_no_campaign_are_refused(options, tmp_path, capsys) -> None:
    assert main(['campaign', 'short_20min', '-o', str(tmp_path / 'out'), *options]) == 2
    assert options[0] in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
