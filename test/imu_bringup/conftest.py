# SPDX-License-Identifier: Apache-2.0
"""The layouts for PlotJuggler and Foxglove, as they are shipped."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

LAYOUTS = Path(__file__).resolve().parents[2] / 'src' / 'imu_bringup' / 'layouts'


@pytest.fixture(scope='module')
def plotjuggler() -> ET.Element:
    return ET.fromstring((LAYOUTS / 'plotjuggler_imu.xml').read_text('utf-8'))  # noqa: S314


@pytest.fixture(scope='module')
def foxglove() -> dict[str, Any]:
    return json.loads((LAYOUTS / 'foxglove_imu.json').read_text('utf-8'))
