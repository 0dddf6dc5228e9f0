# SPDX-License-Identifier: Apache-2.0
"""Results in a notebook: text and table, and only a missing matplotlib is told as one."""

from __future__ import annotations

import pytest
from imu_recording.user_error import UserError

from ..models import line_model


def test_a_result_prints_and_shows_itself() -> None:
    model = line_model()
    assert repr(model).startswith('thermal model of dut1')
    assert model._repr_html_().startswith('<b>thermal model of dut1')


@pytest.mark.parametrize(
    ('missing', 'error', 'message'),
    [
        ('matplotlib.figure', UserError, r'plot\(\) needs matplotlib: pip install matplotlib'),
        ('scipy', ModuleNotFoundError, 'No module named .scipy.'),
    ],
)
def test_a_missing_library_is_told_as_what_it_is(
    missing: str, error: type[Exception], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def picture(model: object) -> None:
        raise ModuleNotFoundError(f'No module named {missing!r}', name=missing)

    monkeypatch.setattr('thermal_comp.presentation.model.picture', picture)
    with pytest.raises(error, match=message):
        line_model().plot()
