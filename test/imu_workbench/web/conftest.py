# SPDX-License-Identifier: Apache-2.0
"""The bags with a hidden effect, read and fitted once as the workers of the page do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.case.tasks import (
    Change,
    ProgressListener,
    change_task,
    diagnose_task,
    held_out_task,
    prepare_task,
    read_task,
    version_task,
)
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import timeline_of
from nicegui import Client
from nicegui.page import page

BAGS = Path(__file__).resolve().parents[3] / 'bags'


@dataclass(frozen=True)
class Fitted:
    """Bags of one device with two versions of its model."""

    bags: list[StoredBag]
    prepared: Path
    line: Version
    lag: Version
    progress: ProgressListener
    told: list[str]
    hashes: dict[str, str]


@pytest.fixture(scope='session')
def fitted(tmp_path_factory) -> Fitted:
    folder = tmp_path_factory.mktemp('stored')
    told: list[str] = []

    def hear(text: str, _share: float = 0.0) -> None:
        told.append(text)

    bags = [
        bag
        for axis in 'xyz'
        for bag in read_task(hear, BAGS / f'hidden_effect_{axis}', folder / axis, {})
    ]
    prepared = folder / 'prepared.runs'
    prepare_task(hear, bags, prepared)
    opened = version_task(hear, prepared, None, 'line per axis', [])
    line = replace(opened.version, timeline=timeline_of(bags))
    change = Change('thermal_lag', ('accelerometer',))
    lag = change_task(hear, prepared, line.model_text, change, [])
    lag = replace(lag, timeline=timeline_of(bags))
    return Fitted(bags, prepared, line, lag, hear, told, opened.hashes)


@pytest.fixture(scope='session')
def found(fitted) -> dict[str, Any]:
    """What is missing in the line: the diagnosis, and the candidates of every sensor."""
    text = fitted.line.model_text
    answer = diagnose_task(fitted.progress, fitted.bags, fitted.prepared, text, [])
    weighed = (fitted.prepared, text, answer['candidates'], [])
    return answer | {'candidates': held_out_task(fitted.progress, *weighed)}


@pytest.fixture
def tab() -> Iterator[Client]:
    """Provide a browser tab that no browser has opened: elements can be drawn in it."""
    client = Client(page('/'), request=None)
    with client:
        yield client
    client.delete()
