# SPDX-License-Identifier: Apache-2.0
"""The board as drawn: which way is up, east and away, within the drawing."""

import re

import numpy as np
import pytest
from imu_workbench.web.live.attitude_drawing import HEIGHT_PX, WIDTH_PX, board_svg, projected
from imu_workbench.web.live.readings import LiveAttitude
from orientation_filters.rotation.arrays import euler_zyx, from_rotation_vector


def test_the_drawing_shows_which_way_is_up_east_and_away() -> None:
    x, y = projected(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])).T
    assert x[1] > x[0] + 20  # east to the right
    assert y[2] < y[0]  # north away: higher on the page
    assert y[3] < y[0] - 20  # up
    assert x[3] == pytest.approx(x[0], abs=1e-9)


@pytest.mark.parametrize('seed', range(8))
def test_the_board_stays_within_the_drawing_in_any_attitude(seed: int) -> None:
    turn = from_rotation_vector(np.random.default_rng(seed).normal(0.0, 2.0, 3))
    drawing = board_svg('AHRS', LiveAttitude(turn, euler_zyx(turn)), '@d1', 'dark')
    corners = ' '.join(re.findall(r'points="([^"]+)"', drawing)).replace(',', ' ').split()
    across = [float(x) for x in corners[::2] + re.findall(r' x\d?="([^"]+)"', drawing)]
    down = [float(y) for y in corners[1::2] + re.findall(r' y\d?="([^"]+)"', drawing)]
    assert 0 <= min(across) < max(across) <= WIDTH_PX
    assert 0 <= min(down) < max(down) <= HEIGHT_PX
    faces = drawing.count('<polygon') // 2
    assert 1 <= faces <= 4
    assert 'aria-label="AHRS: roll' in drawing
    assert '@' not in drawing
