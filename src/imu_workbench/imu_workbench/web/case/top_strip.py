# SPDX-License-Identifier: Apache-2.0
"""The top of the page: defects of the data, the verdict in a sentence, one thing to do next."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from typing import Any

from nicegui import ui
from thermal_comp.presentation.display import DISPLAY_UNITS

from imu_workbench.web.case.buttons import Buttons
from imu_workbench.web.case.verdict import (
    Action,
    data_alerts,
    next_action,
    smallest_sizes,
    verdict_sentence,
    what_would_be_found,
)
from imu_workbench.web.session import Session
from imu_workbench.web.words import word

MOST_ALERTS = 2
"""Alerts above the verdict; more would push verdict and figures off the screen."""


def _show_alerts(alerts: Sequence[str]) -> None:
    for text in alerts:
        ui.label(text).classes('alert')


@dataclass(frozen=True)
class TopActions:
    """What the strip asks the page to do."""

    preview: Callable[[str, tuple[str, ...]], Any]
    add: Callable[[str, tuple[str, ...]], Any]
    plan: Callable[[str, str], Any]
    certificate: Callable[[], Any]


class TopStrip:
    """Alerts, verdict and next action of the version looked at."""

    def __init__(self, session: Session, actions: TopActions) -> None:
        self._session, self._actions = session, actions
        self._drawn: tuple[Any, ...] | None = None
        with ui.element('section').classes('card top').props('aria-label="Verdict"'):
            self._alerts = ui.element('div').classes('alerts').props('role=alert')
            self._sentence = ui.element('div').classes('verdict').props('aria-live=polite')
            self._row = ui.row().classes('actions')
            self._buttons = Buttons(self._row)

    def refresh(self) -> None:
        """Show what is known by now."""
        session = self._session
        work, version, found = session.work, session.version, session.diagnosis
        alerts = data_alerts(found, self._notes())
        action = self._action()
        drawn = (
            session.device, session.version_name, id(version), id(found), tuple(alerts), action,
            session.candidate, self._waiting(), bool(work and work.bags),
        )  # fmt: skip
        if drawn == self._drawn:
            return
        self._drawn = drawn
        self._alerts.clear()
        with self._alerts:
            _show_alerts(alerts[:MOST_ALERTS])
            if len(alerts) > MOST_ALERTS:
                with ui.element('details'):
                    with ui.element('summary'):
                        ui.label(f'{len(alerts) - MOST_ALERTS} more about the recordings')
                    _show_alerts(alerts[MOST_ALERTS:])
        self._show_sentence()
        self._show_action(action)

    def _notes(self) -> list[str]:
        """Return the notes on reading the recordings."""
        work = self._session.work
        if work is None:
            return []
        left = [f'{reason}; it is left out' for reason in work.left_out.values()]
        runs: dict[str, list[str]] = {}
        for bag in work.bags:
            for note in bag.notes:
                runs.setdefault(note, []).append(bag.run)
        return [*(f'{", ".join(names)}: {note}' for note, names in runs.items()), *left]

    def _action(self) -> Action:
        session, found = self._session, self._session.diagnosis
        if found is None or session.work is None or session.version is None:
            return Action('none')
        effects = session.workspace.effects.explained
        addable = [name for name, told in effects.items() if told['searched']]
        return next_action(found, list(effects), addable)

    def _waiting(self) -> str:
        session = self._session
        if session.version is None or session.work is None:
            return session.nothing_yet
        if session.workspace.answers.is_diagnosing(session.device, session.version_name):
            return 'Looking for what is missing: every effect of the catalogue is asked …'
        return 'Nobody has asked yet what is missing: the answer was cancelled or failed.'

    def _show_sentence(self) -> None:
        session, found = self._session, self._session.diagnosis
        self._sentence.clear()
        kind = found['verdict'] if found else 'waiting'
        self._sentence.classes(replace=f'verdict {kind}')
        with self._sentence:
            if found is None or session.errors is None:
                ui.label(self._waiting()).classes('sentence')
                return
            ui.label(verdict_sentence(found, session.errors)).classes('sentence')
            if session.version is None:
                ui.label(f'As it was found before. {session.nothing_yet}').classes('soft')
            smallest = what_would_be_found(found)
            if smallest:
                with ui.element('details').classes('soft sizes'):  # open, it hides the figures
                    with ui.element('summary'):
                        sizes = smallest_sizes(found)
                        ui.label(f'Smallest effects that would have been found: {sizes} rms')
                    ui.html(smallest_found_html(smallest), sanitize=False)
            words = f'{word("noise")} · {word("held out")} · {word("evidence")}'
            ui.html(f'<span class="soft">What is meant by {words}</span>', sanitize=False)

    def _show_action(self, action: Action) -> None:
        self._row.clear()
        session, do = self._session, self._actions
        with self._row:
            if action.kind == 'none':
                about, work = (session.device, session.version_name), session.workspace
                if session.failed:
                    again = partial(work.versions.try_again, *about)
                    name = session.version_name  # none yet before the first comparison
                    label = f'Try {name} again' if name else 'Try again'
                    self._add(label, 'unelevated', again)
                elif session.version is not None and not work.answers.is_diagnosing(*about):
                    ask = partial(work.answers.ask, *about)
                    self._add('Ask what is missing', 'unelevated', ask)
                return
            if action.text:
                ui.label(f'Next: {action.text}').classes('next')
            if action.kind == 'experiment':
                one, other = (name.replace('_', ' ') for name in action.rivals)
                label = f'Plan the experiment: {one} or {other}?'
                self._add(label, 'unelevated', partial(do.plan, *action.rivals))
            if action.effect:
                self._offer(action)
            if action.kind == 'certificate':
                self._add('Save the certificate', 'unelevated', do.certificate)

    def _offer(self, action: Action) -> None:
        do, name = self._actions, action.effect.replace('_', ' ')
        previewed = self._session.candidate == action.effect
        first = not previewed and action.kind == 'add'
        look = 'unelevated' if first else 'outline'
        if not previewed:
            self._add(f'Preview {name}', look, partial(do.preview, action.effect, action.sensors))
        look = 'unelevated' if previewed and action.kind == 'add' else 'outline'
        self._add(f'Add {name}', look, partial(do.add, action.effect, action.sensors))

    def _add(self, label: str, look: str, act: Callable[[], Any]) -> None:
        session = self._session
        key = f'{label} {session.device} {session.version_name}'
        self._buttons.add(label, key, act).props(look)


def smallest_found_html(smallest: Mapping[str, Mapping[str, str]]) -> str:
    """Return tables beside each other: a row per effect, a column per sensor."""
    sensors = [s for s in DISPLAY_UNITS if any(s in row for row in smallest.values())]
    head = ''.join(f'<th>{s.capitalize()} [{DISPLAY_UNITS[s].unit}]</th>' for s in sensors)
    rows = [
        f'<tr><th scope="row">{escape(effect.replace("_", " "))}</th>'
        + ''.join(f'<td>{row.get(sensor, "–")}</td>' for sensor in sensors)
        + '</tr>'
        for effect, row in smallest.items()
    ]
    return '<div class="smallest">' + ''.join(
        f'<table><thead><tr><th>Effect, rms</th>{head}</tr></thead><tbody>{"".join(part)}</tbody>'
        '</table>'
        for part in _halves(rows)
    ) + '</div>'  # fmt: skip


def _halves(rows: Sequence[str]) -> list[Sequence[str]]:
    middle = (len(rows) + 1) // 2
    return [rows[:middle], rows[middle:]] if middle < len(rows) else [rows]
