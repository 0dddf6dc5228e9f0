# SPDX-License-Identifier: Apache-2.0
"""Sensors and axes to choose from, each with its error in units of the noise floor."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, shown

from imu_workbench.web.case.verdict import AT_FLOOR_RATIO
from imu_workbench.web.session import Session


class ChannelSelector:
    """Three sensors with their held-out error, three axes; the chosen ones are framed."""

    def __init__(self, session: Session, choose: Callable[[str, int], None]) -> None:
        self._session = session
        self._choose = choose
        self._sensors: dict[str, tuple[ui.element, ui.label, ui.label]] = {}
        self._axes: list[tuple[ui.element, ui.label]] = []
        self._place = ui.element('div').classes('tiles')
        with self._place.props('role=group aria-label="sensor and axis"'):
            for sensor in SENSORS:
                button = ui.element('button').classes('tile').props('type=button')
                button.on('click', lambda _, sensor=sensor: self._pick(sensor=sensor))
                with button:
                    ui.label(sensor.capitalize()).classes('tile-name')
                    value = ui.label('–').classes('tile-value number')
                    state = ui.label('').classes('tile-state')
                self._sensors[sensor] = (button, value, state)
            with ui.element('div').classes('axes'):
                for number, axis in enumerate('xyz'):
                    button = ui.element('button').classes('axis').props('type=button')
                    button.on('click', lambda _, number=number: self._pick(axis=number))
                    with button:
                        ui.label(axis).classes('axis-name')
                        ratio = ui.label('').classes('number')
                    self._axes.append((button, ratio))

    def _pick(self, sensor: str | None = None, axis: int | None = None) -> None:
        view = self._session.view
        self._choose(sensor or view.sensor, view.axis if axis is None else axis)

    def refresh(self) -> None:
        """Show the version looked at."""
        version, view = self._session.version, self._session.view
        known = self._session.sensors()
        for sensor, (button, value, state) in self._sensors.items():
            on = sensor == view.sensor
            button.classes(remove='on bad good')
            button.props(f'aria-pressed={"true" if on else "false"}')
            if on:
                button.classes('on')
            if version is None or sensor not in known:
                value.set_text('–')
                state.set_text('not in these runs' if version else '')
                continue
            error, floor = version.error(sensor), version.floor(sensor)
            unit = DISPLAY_UNITS[sensor]
            value.set_text(f'{shown(error * unit.factor)} {unit.unit}')
            ratio = error / floor
            button.classes('good' if ratio <= AT_FLOOR_RATIO else 'bad')
            state.set_text(
                f'{"at" if ratio <= AT_FLOOR_RATIO else f"{ratio:.2f} ×"} the noise floor '
                f'{shown(floor * unit.factor)} {unit.unit}'
            )
        for number, (button, label) in enumerate(self._axes):
            on = number == view.axis
            button.classes(remove='on')
            button.props(f'aria-pressed={"true" if on else "false"}')
            if on:
                button.classes('on')
            label.set_text(self._axis_ratio(number))

    def _axis_ratio(self, axis: int) -> str:
        version, sensor = self._session.version, self._session.view.sensor
        if version is None or sensor not in self._session.sensors():
            return ''
        part = version.comparison['sensors'][sensor]
        error, floor = part['held_out_rms'][axis], part['noise_floor'][axis]
        return f'{error / floor:.2f} ×' if error is not None and floor else ''
