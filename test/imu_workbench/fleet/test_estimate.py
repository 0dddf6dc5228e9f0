# SPDX-License-Identifier: Apache-2.0
"""One device of a fleet: what its rows depend on, and effects of the user's own among them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from imu_workbench.fleet.estimate import EstimateSettings, estimate_device
from imu_workbench.fleet.sources import find_devices

OWN = """
from thermal_comp.effects.thermal_lag import ThermalLag

class OwnLag(ThermalLag):
    name = 'own_lag'
"""


def test_settings_depend_on_the_code_of_effects_not_on_where_it_stands(tmp_path: Path) -> None:
    plain = EstimateSettings()
    assert EstimateSettings.of() == plain
    assert EstimateSettings.of(diagnose=True).hash != plain.hash
    one, other = tmp_path / 'one.py', tmp_path / 'other.py'
    one.write_text(OWN)
    other.write_text(OWN)
    first = EstimateSettings.of([one])
    assert first.hash == EstimateSettings.of([other]).hash != plain.hash
    one.write_text(OWN + '\n')
    assert EstimateSettings.of([one]).hash != first.hash


@pytest.mark.long
def test_a_device_is_tried_for_the_effects_of_a_file(fleet_bags: Path, tmp_path: Path) -> None:
    (source,) = find_devices([f'{fleet_bags}/lot=B'])
    file = tmp_path / 'own.py'
    file.write_text(OWN)
    settings = EstimateSettings.of([file])
    rows = estimate_device(source, settings)
    gains = {
        name: [row['gain'] for row in rows if row.get('effect') == name]
        for name in ('own_lag', 'thermal_lag')
    }
    assert gains['own_lag'] == gains['thermal_lag'] != []
    assert {row['settings'] for row in rows} == {settings.hash}


def test_a_file_that_is_another_on_a_worker_is_tried_again(
    fleet_bags: Path, tmp_path: Path
) -> None:
    (source,) = find_devices([f'{fleet_bags}/lot=B'])
    file = tmp_path / 'own.py'
    file.write_text(OWN)
    settings = EstimateSettings.of([file])
    file.write_text(OWN + '\n# changed\n')
    (row,) = estimate_device(source, settings)
    assert (row['role'], row['fingerprint']) == ('failed', '')
    assert 'own.py: not what it was when the run began' in row['reason']
    absent = replace(settings, effects=(str(tmp_path / 'absent.py'),))
    (row,) = estimate_device(source, absent)
    assert 'absent.py: cannot be read' in row['reason']
    assert row['fingerprint'] == ''
