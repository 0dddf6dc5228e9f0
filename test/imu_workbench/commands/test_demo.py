# SPDX-License-Identifier: Apache-2.0
"""demo: without the bundled bags it says where to look, and leaves nothing behind."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

import pytest
from imu_recording.user_error import UserError
from imu_workbench.commands import demo


@pytest.mark.parametrize('present', [(), ('dut1_x',), ('hidden_effect_x',)])
def test_a_folder_without_all_bags_is_refused(present: tuple[str, ...], tmp_path: Path) -> None:
    bags, output = tmp_path / 'bags', tmp_path / 'demo'
    for name in present:
        (bags / name).mkdir(parents=True)
    parser = ArgumentParser()
    demo.arguments(parser)
    options = parser.parse_args(['--bags', str(bags), '-o', str(output)])
    with pytest.raises(UserError, match=r'no bags dut\?_\? and hidden_effect_\? here; .* --bags$'):
        demo.run(options)
    assert not output.exists()


def test_the_bundled_bags_are_all_it_needs(bags: Path) -> None:
    assert len(sorted(bags.glob('dut?_?'))) >= 3
    assert len(sorted(bags.glob('hidden_effect_?'))) == 3
