# SPDX-License-Identifier: Apache-2.0
"""compare: the numbers of the fit again, and a picture of the residual."""

import json
from pathlib import Path

import numpy as np
from imu_workbench.__main__ import main
from matplotlib.image import imread


def test_compare_with_the_saved_model_gives_the_numbers_of_the_fit(
    device_bags: Path, dut1_model: Path, tmp_path: Path
) -> None:
    bag = str(device_bags / 'dut1')
    files = [tmp_path / 'a.json', tmp_path / 'b.json']
    assert main(['compare', bag, '--model', str(dut1_model), '--json', str(files[0])]) == 0
    assert main(['compare', bag, '--json', str(files[1])]) == 0
    saved, fresh = (json.loads(file.read_text())['sensors'] for file in files)
    for sensor, part in saved.items():
        np.testing.assert_allclose(part['residual_rms'], fresh[sensor]['residual_rms'], rtol=1e-9)
        np.testing.assert_allclose(part['held_out_rms'], fresh[sensor]['held_out_rms'], rtol=1e-6)


def test_compare_draws_the_residual_over_time(
    device_bags: Path, dut1_model: Path, tmp_path: Path, capsys
) -> None:
    picture = tmp_path / 'residual.png'
    argv = ['compare', str(device_bags / 'dut1'), '--model', str(dut1_model), '--plot']
    assert main([*argv, str(picture)]) == 0
    pixels = imread(picture)[:, :, :3]
    assert (pixels[0, 0] == 1.0).all(), 'the background is white'
    dark = (pixels.min(axis=2) < 0.8).mean()
    assert dark > 0.02, 'lines are drawn'
    assert main([*argv, str(picture)]) == 2
    assert '--force' in capsys.readouterr().err
    assert main([*argv, str(tmp_path / 'residual.xyz')]) == 2
    assert '.png, .svg, .pdf' in capsys.readouterr().err
