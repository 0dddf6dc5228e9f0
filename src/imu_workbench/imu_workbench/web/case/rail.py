# SPDX-License-Identifier: Apache-2.0
"""The column on the right: what may be missing in the sensor looked at, most probable first."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from typing import Any

from nicegui import ui
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import COUNT_UNIT
from thermal_comp.presentation.diagnosis import explanation_name, percent
from thermal_comp.presentation.display import DISPLAY_UNITS, shown

from imu_workbench.web.case.buttons import Buttons, file_button
from imu_workbench.web.case.candidates import LEAST_SHOWN_PROBABILITY, EffectCandidate, why_not
from imu_workbench.web.case.preview import EffectPreview
from imu_workbench.web.case.version import Version, parameter_text
from imu_workbench.web.session import Session
from imu_workbench.web.words import spaced, word

LEAST_JOINT_PROBABILITY = 0.05
"""Probability of explanations with several effects from which all explanations are listed."""
MOST_CANDIDATES = 4
"""Candidates that are shown at once; others are listed below, folded."""


@dataclass(frozen=True)
class RailActions:
    """What the rail asks the page to do."""

    preview: Callable[[str], Any]
    add: Callable[[str, tuple[str, ...]], Any]
    take_out: Callable[[str, tuple[str, ...]], Any]
    explain: Callable[[str], Any]
    load_effects: Callable[[str, bytes], Awaitable[None]]
    load_kept: Callable[[str], Any]


class Rail:
    """Candidates of one sensor, effects in its model, and effects that cannot be tried."""

    def __init__(self, session: Session, actions: RailActions, *, may_load: bool) -> None:
        self._session, self._actions = session, actions
        self._drawn: tuple[Any, ...] | None = None
        self._may_load, self._offered = may_load, dict[str, str]()
        self._open: dict[str, bool] = {}
        self._section = ui.element('section').classes('card rail')
        self._buttons = Buttons(self._section)
        with self._section.props('aria-label="Candidates" aria-busy=true'):
            self._place = ui.element('div')
            self._kept = ui.element('div')
            label = 'Load an effect file (.py)'
            if may_load:
                file_button(label, '.py', actions.load_effects)
            else:
                ui.button(label).props('no-caps outline').set_enabled(False)
                text = 'Effect files run code: loading them is off where others can open the page.'
                ui.label(text).classes('reason')

    def refresh(self, preview: EffectPreview | None) -> None:
        """Show the candidates of the sensor looked at."""
        self._offer_kept()
        session = self._session
        version, work, sensor = session.version, session.work, session.view.sensor
        found = work.found.get(session.version_name) if work else None
        effects = session.workspace.effects.explained
        drawn = (
            session.device, session.version_name, sensor, id(version), id(found),
            session.candidate, id(preview), len(effects), session.failed,
        )  # fmt: skip
        if drawn == self._drawn:
            return
        self._drawn = drawn
        waits = work is not None and session.workspace.answers.is_holding_out(
            session.device, session.version_name
        )
        busy = not session.failed and (found is None or version is None or waits)
        self._section.props(f'aria-busy={"true" if busy else "false"}')
        self._place.clear()
        with self._place:
            ui.html(f'<h2>What may be missing in the {escape(sensor)}</h2>', sanitize=False)
            if version is None or work is None:
                awaited = f'{session.version_name} is compared with the recordings'
                awaited = awaited if session.failed else 'the catalogue was asked'
                ui.label(f'Candidates stand here once {awaited}.').classes('soft')
                return
            if sensor not in version.comparison['sensors']:
                ui.label('The sensors that were measured stand above.').classes('soft')
                return
            self._show_inside(version)
            if found is None:
                ui.label('Candidates stand here once the catalogue was asked.').classes('soft')
                return
            ui.html(together_html(found['diagnosis']['explanations'], sensor), sanitize=False)
            self._show(self._candidates(preview), version, preview)
            if waits:
                ui.label('What they would leave held out is being computed …').classes('soft')

    def _offer_kept(self) -> None:
        """Offer the effect files that the case keeps and that are not loaded."""
        work = self._session.work
        kept = self._session.workspace.effects.not_loaded(work.case) if work else {}
        if kept == self._offered:
            return
        self._offered = kept
        self._kept.clear()
        with self._kept:
            for key, name in kept.items():
                act = partial(self._actions.load_kept, key)
                button = self._buttons.add(f'Load {name}, kept in this case', f'load {key}', act)
                button.props('outline').set_enabled(self._may_load)
                ui.label(f'It runs code: SHA-256 {key[:16]}.').classes('reason')

    def _candidates(self, preview: EffectPreview | None) -> list[EffectCandidate]:
        """Return what may be missing, with the user's own effects that have no probability."""
        session = self._session
        work, sensor = session.work, session.view.sensor
        assert work is not None and session.version is not None  # noqa: S101 PT018 (asked before)
        weighed = work.candidates(session.version_name, sensor)
        inside = session.version.effects.get(sensor, ())
        known = {one.effect for one in weighed} | set(inside)
        for name, told in session.workspace.effects.explained.items():
            fits = sensor in told['sensors'] and told['searched'] and name not in work.unusable
            if fits and name not in known:
                weighed.append(
                    EffectCandidate(
                        effect=name,
                        sensor=sensor,
                        probability=None,
                        log_odds=None,
                        error_after=None,
                    )
                )
        if preview is not None and preview.sensor == sensor:
            weighed = [
                replace(one, error_after=preview.error_after)
                if one.effect == preview.effect and one.error_after is None
                else one
                for one in weighed
            ]
        return weighed

    def _show(
        self,
        candidates: Sequence[EffectCandidate],
        version: Version,
        preview: EffectPreview | None,
    ) -> None:
        before = version.error(self._session.view.sensor)
        useful = [c for c in candidates if c.named or c.empirical or c.lowers(before)]
        useful = sorted(useful, key=lambda c: (not c.named, not c.empirical))[:MOST_CANDIDATES]
        winner = next((c for c in useful if c.named), None)
        named = [c.effect for c in useful if c.named]
        for candidate in useful:
            beside = [spaced(name) for name in named if name != candidate.effect]
            self._card(candidate, winner, beside, version, preview)
        rest = [c for c in candidates if c not in useful]
        if not useful:
            ui.label('No candidate would lower the held-out error.').classes('note')
        self._group('Further effects' if useful else 'Effects that add nothing', rest, version)
        self._show_unusable()

    def _card(
        self,
        candidate: EffectCandidate,
        winner: EffectCandidate | None,
        beside: Sequence[str],
        version: Version,
        preview: EffectPreview | None,
    ) -> None:
        name = spaced(candidate.effect)
        on = self._session.candidate == candidate.effect
        with (
            ui.element('article')
            .classes('candidate on' if on else 'candidate')
            .props(f'aria-label="{escape(name)}"')
        ):
            percentage = probability_text(candidate.probability)
            probability = word(percentage, 'probability') if percentage else ''
            empirical = f' <span class="chip">{word("empirical")}</span>'
            ui.html(
                f'<h3>{escape(name)}{empirical if candidate.empirical else ""}'
                f'<span class="number">{probability}</span></h3>',
                sanitize=False,
            )
            ui.html(errors_html(candidate, version), sanitize=False)
            if candidate.named and beside:
                ui.label(f'Together with {" and ".join(beside)}.').classes('note')
            for key, value in candidate.parameters.items():
                unit = value['unit'].removeprefix(COUNT_UNIT)
                text = f'{parameter_text(value["value"], value.get("std"))} {unit}'
                ui.label(f'{key.replace("_", " ")} {text}').classes('soft')
            lost = why_not(candidate, winner, version.error(candidate.sensor))
            if lost:
                ui.label(f'Why not: {lost[0].lower()}{lost[1:]}').classes('note')
            if on and preview is not None and preview.effect == candidate.effect:
                share = preview.share[self._session.view.axis]
                ui.label(
                    f'Drawn over the residual: it would explain {100.0 * share:.0f} % of the '
                    f'variance of {self._session.view.axis_name}.'
                ).classes('note')
            self._offer(candidate, on=on, add='Add')

    def _offer(self, candidate: EffectCandidate, *, on: bool, add: str) -> None:
        do, effect, sensor = self._actions, candidate.effect, candidate.sensor
        name = spaced(effect)
        with ui.row().classes('actions small'):
            for key, label, act in (
                ('preview', 'Hide' if on else 'Preview', partial(do.preview, effect)),
                ('explain', 'Explain', partial(do.explain, effect)),
                ('add', add, partial(do.add, effect, (sensor,))),
            ):
                button = self._buttons.add(label, f'{key} {sensor} {effect}', act)
                button.props(f'outline dense aria-label="{label} {name}"')

    def _group(self, title: str, rest: Sequence[EffectCandidate], version: Version) -> None:
        if not rest:
            return
        before = version.error(self._session.view.sensor)
        names = [c.effect for c in rest]
        with ui.element('details').classes('further') as group:
            own = (c.effect for c in rest if c.effect not in EFFECTS)  # of the user
            if self._open.get('further') or self._session.candidate in names or any(own):
                group.props('open')
            group.on('toggle', self._remember)
            with ui.element('summary'):
                ui.label(f'{title} ({len(rest)})')
            for candidate in rest:
                on = self._session.candidate == candidate.effect
                with ui.element('div').classes('other on' if on else 'other'):
                    ui.label(spaced(candidate.effect)).classes('other-name')
                    ui.label(little_text(candidate, before)).classes('reason')
                    self._offer(candidate, on=on, add='Add anyway')

    def _remember(self) -> None:
        self._open['further'] = not self._open.get('further', False)

    def _show_inside(self, version: Version) -> None:
        """List the effects of the model, with a button to take each out."""
        sensor, effects = self._session.view.sensor, self._session.workspace.effects.explained
        inside = version.effects.get(sensor, ())
        with ui.element('div').classes('inside'):
            ui.label('In the model:').classes('soft')
            for name in inside:
                with ui.element('span').classes('term'):
                    ui.label(spaced(name))
                    removable = name in effects and effects[name]['searched']
                    if removable:
                        button = ui.element('button').classes('close').props('type=button')
                        button.props(f'aria-label="take {name.replace("_", " ")} out"')
                        act = partial(self._actions.take_out, name, (sensor,))
                        self._buttons.heard(button, f'take out {sensor} {name}', act)
                        with button:
                            ui.label('×')

    def _show_unusable(self) -> None:
        work, sensor = self._session.work, self._session.view.sensor
        effects = self._session.workspace.effects.explained
        reasons: dict[str, list[str]] = {}
        for name, reason in (work.unusable if work else {}).items():
            if name in effects and sensor in effects[name]['sensors']:
                reasons.setdefault(reason, []).append(spaced(name))
        for reason, names in reasons.items():
            ui.label(f'Cannot be tried: {", ".join(names)}: {reason}.').classes('reason')


def together_html(explanations: Sequence[Mapping[str, Any]], sensor: str) -> str:
    """Return the explanations of a sensor, which add up to one, where some have several effects.

    An effect's own probability is that of all explanations it is part of: of two effects that act
    together each has nearly one.
    """
    own = [one for one in explanations if one['sensor'] == sensor]
    if sum(one['probability'] for one in own if len(one['names']) > 1) < LEAST_JOINT_PROBABILITY:
        return ''
    rows = [(spaced(explanation_name(one)), one['probability']) for one in own]
    rest = 1.0 - sum(probability for _, probability in rows)
    rows += [('anything else', rest)] if rest >= LEAST_SHOWN_PROBABILITY else []
    items = ''.join(
        f'<li>{escape(name)}<span class="number">{probability_text(probability)}</span></li>'
        for name, probability in rows
    )
    return (
        f'<div class="together"><p class="soft">Explanations, 100 % in all:</p><ul>{items}</ul>'
        '<p class="reason">Beside an effect below stands what all explanations it is part of have '
        'together: effects that act together do not share 100 %.</p></div>'
    )


def probability_text(probability: float | None) -> str:
    """Return a probability in percent; nothing is certain and nothing impossible."""
    if probability is None:
        return ''
    return '< 1 %' if probability < LEAST_SHOWN_PROBABILITY else percent(probability)


def errors_html(candidate: EffectCandidate, version: Version) -> str:
    """Return held-out error before → after → floor with its unit."""
    unit = DISPLAY_UNITS[candidate.sensor]
    before, floor = version.error(candidate.sensor), version.floor(candidate.sensor)
    after = candidate.error_after
    texts = [shown(value * unit.factor) for value in (before, after or 0.0, floor)]
    known = f'<b>{texts[1]}</b>' if after is not None else '?'
    times = f' ({after / floor:.2f} ×)' if after is not None and floor else ''
    return (
        f'<p class="errors"><span class="soft">{word("held-out error")}</span> {texts[0]} → '
        f'{known} {unit.unit}{times} <span class="soft">floor {texts[2]} {unit.unit}</span></p>'
    )


def little_text(candidate: EffectCandidate, before: float) -> str:
    """Return in words how little an effect lowers the error."""
    if candidate.error_after is not None and not candidate.lowers(before):
        return 'Adds nothing: the held-out error would not fall.'
    if candidate.error_after is not None:
        unit = DISPLAY_UNITS[candidate.sensor]
        after = shown(candidate.error_after * unit.factor)
        return f'Would leave {after} {unit.unit} held out.'
    if candidate.log_odds is not None and candidate.log_odds < 0.0:
        return 'Adds nothing: less likely than no effect at all.'
    if candidate.probability is None:
        return 'Was not weighed: preview it to see what it would do.'
    return 'Explains a part; preview it for the held-out error.'
