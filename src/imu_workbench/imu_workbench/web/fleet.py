# SPDX-License-Identifier: Apache-2.0
"""The cases of a server as a fleet: device by device its error over the noise, worst first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import ui
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, shown

from imu_workbench.case import Case
from imu_workbench.web.case.verdict import AT_FLOOR_RATIO
from imu_workbench.web.words import word

MOST_DEVICES = 500
"""Devices that are shown."""


@dataclass(frozen=True)
class FleetRow:
    """One device by the version of its model that was shown last."""

    device: str
    version: str
    """Its name and what was done to get there; '' where there is none."""
    errors: Mapping[str, Mapping[str, float]]
    """Per sensor: `error`, held out, and `floor`, rms over the axes [SI unit]."""
    verdict: str = ''
    """The answer in a sentence; '' where there is none yet."""

    def ratio(self, sensor: str) -> float | None:
        """Return the held-out error over the noise floor; None of a sensor without either."""
        part = self.errors.get(sensor)
        return part['error'] / part['floor'] if part and part['floor'] > 0.0 else None

    @property
    def worst(self) -> float:
        """The largest ratio of all sensors; 0 where none is known."""
        return max((ratio for s in self.errors if (ratio := self.ratio(s))), default=0.0)


def fleet_rows(cases: Sequence[tuple[Case, str]]) -> list[FleetRow]:
    """Return a row for each device, the largest error over its noise floor first."""
    rows = []
    for case, verdict in cases:
        version = case.version(case.current)
        label = f'{version.name} {version.label.replace("_", " ")}' if version else ''
        errors = version.errors if version else {}
        rows.append(FleetRow(case.device, label, errors, verdict))
    return sorted(rows, key=lambda row: (-row.worst, row.device))


def error_text(row: FleetRow, sensor: str) -> str:
    """Return a sensor's error with its unit and its ratio to the noise floor; '–' without one."""
    ratio = row.ratio(sensor)
    if ratio is None:
        return '–'
    unit = DISPLAY_UNITS[sensor]
    return f'{shown(row.errors[sensor]["error"] * unit.factor)} {unit.unit} ({ratio:.2f} ×)'


class FleetView:
    """The table of devices; a row opens the case of its device."""

    def __init__(
        self, cases: Callable[[], Sequence[tuple[Case, str]]], show: Callable[[str], Any]
    ) -> None:
        self._cases, self._show = cases, show
        self._drawn: list[FleetRow] | None = None
        with ui.element('section').classes('card fleet').props('aria-label="Fleet"'):
            ui.html('<h2>Devices, the worst first</h2>', sanitize=False)
            ui.html(
                f'<p class="soft">Each sensor with its {word("held-out error")} and its ratio to '
                f'the {word("noise floor")}, by the version shown last.</p>',
                sanitize=False,
            )
            self._place = ui.element('div').classes('scroll')

    def refresh(self) -> None:
        """Show the cases as they are now."""
        rows = fleet_rows(self._cases())
        if rows == self._drawn:
            return
        self._drawn = rows
        self._place.clear()
        with self._place:
            if not rows:
                ui.label('There is no case yet: open bags of a device.').classes('soft')
                return
            with ui.element('table').classes('fleet-table'):
                self._head()
                with ui.element('tbody'):
                    for row in rows[:MOST_DEVICES]:
                        self._row(row)
            if len(rows) > MOST_DEVICES:
                ui.label(f'{len(rows) - MOST_DEVICES} more devices fail less.').classes('soft')

    def _head(self) -> None:
        with ui.element('thead'), ui.element('tr'):
            sensors = (sensor.capitalize() for sensor in SENSORS)
            for title in ('Device', 'Verdict', *sensors, 'Version'):
                with ui.element('th').props('scope=col'):
                    ui.label(title)

    def _row(self, row: FleetRow) -> None:
        with ui.element('tr'):
            with ui.element('th').props('scope=row'):
                button = ui.element('button').classes('version').props('type=button')
                button.on('click', lambda: self._show(row.device))
                with button:
                    ui.label(row.device)
            with ui.element('td').classes('fleet-verdict'):
                ui.label(row.verdict or 'not asked yet')
            for sensor in SENSORS:
                ratio = row.ratio(sensor)
                state = '' if ratio is None else 'good' if ratio <= AT_FLOOR_RATIO else 'bad'
                with ui.element('td').classes(f'number {state}'):
                    ui.label(error_text(row, sensor))
            with ui.element('td'):
                ui.label(row.version or 'not fitted yet').classes('soft')
