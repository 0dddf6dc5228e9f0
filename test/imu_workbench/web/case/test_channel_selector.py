# SPDX-License-Identifier: Apache-2.0
"""Tiles of the sensors: held-out error, its ratio to the noise floor, the chosen one framed."""

from __future__ import annotations

from types import SimpleNamespace

from imu_workbench.web.case.channel_selector import ChannelSelector
from imu_workbench.web.case.view import View
from nicegui import Client, ui
from thermal_comp.data.conditions import SENSORS


def tiles_of(client: Client) -> list[tuple[ui.element, list[str]]]:
    """Return every button with its texts."""
    buttons = [e for e in client.elements.values() if e.tag == 'button']
    return [(b, [c.text for c in b if isinstance(c, ui.label)]) for b in buttons]


def session_of(version, view: View) -> SimpleNamespace:
    known = [sensor for sensor in SENSORS if version and sensor in version.comparison['sensors']]
    return SimpleNamespace(version=version, view=view, sensors=lambda: known)


def test_the_sensor_that_lags_is_bad_under_a_line_and_good_with_the_lag(tab, fitted) -> None:
    session = session_of(fitted.line, View('accelerometer', 2))
    selector = ChannelSelector(session, lambda *_: None)
    selector.refresh()
    told = {texts[0]: (button, texts) for button, texts in tiles_of(tab)}
    button, texts = told['Accelerometer']
    ratio = fitted.line.error('accelerometer') / fitted.line.floor('accelerometer')
    assert f'{ratio:.2f} × the noise floor' in texts[2]
    assert {'on', 'bad'} <= set(button.classes)
    assert button.props['aria-pressed'] == 'true'
    assert told['z'][0].props['aria-pressed'] == 'true'
    session.version = fitted.lag
    selector.refresh()
    button, texts = next(t for t in tiles_of(tab) if t[1][0] == 'Accelerometer')
    assert texts[2].startswith('at the noise floor')
    assert {'on', 'good'} <= set(button.classes)


def test_without_a_version_nothing_is_said_of_errors(tab) -> None:
    ChannelSelector(session_of(None, View('gyroscope', 0)), lambda *_: None).refresh()
    for _, texts in tiles_of(tab):
        assert texts[1:] in (['–', ''], [''])


def test_a_press_keeps_what_it_does_not_change(tab) -> None:
    chosen: list[tuple[str, int]] = []
    session = session_of(None, View('gyroscope', 1))
    ChannelSelector(session, lambda sensor, axis: chosen.append((sensor, axis)))
    for name in ('Magnetometer', 'z'):
        button = next(b for b, texts in tiles_of(tab) if texts[0] == name)
        (heard,) = button._event_listeners.values()
        heard.handler(None)
    assert chosen == [('magnetometer', 1), ('gyroscope', 2)]
