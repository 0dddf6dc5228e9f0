# SPDX-License-Identifier: Apache-2.0
"""Learn: the diagnosis, each effect explained, and the experiment that separates two of them."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import log
from typing import Any

from nicegui import ui
from thermal_comp.experiment.design import SEPARATING_EVIDENCE
from thermal_comp.presentation.diagnosis import VERDICTS
from thermal_comp.presentation.display import DISPLAY_UNITS, fixed, shown

from imu_workbench.web.case.next_experiment import profile_figure
from imu_workbench.web.case.preview import EffectPreview, preview_figure
from imu_workbench.web.case.version import parameter_text
from imu_workbench.web.case.view import timeline_of
from imu_workbench.web.plot import Look, Plot
from imu_workbench.web.session import Session


@dataclass(frozen=True)
class LearnActions:
    """What the page asks the tab to do."""

    diagnose: Callable[[], Awaitable[None]]
    add: Callable[[str, list[str]], Awaitable[None]]
    preview: Callable[[str, str], Awaitable[EffectPreview | None]]
    next_profile: Callable[[str, str], Awaitable[Mapping[str, Any] | None]]


class LearnPage:
    """The diagnosis as a ranked list; beside it one effect explained."""

    def __init__(self, session: Session, look: Look, actions: LearnActions) -> None:
        self._session, self._look = session, look
        self._actions = actions
        self._effect = ''
        self._plots: list[Plot] = []
        with ui.element('div').classes('grid-learn'):
            self._findings = ui.element('section').classes('card')
            self._explanation = ui.element('section').classes('card')
            self._list = ui.element('section').classes('card span')

    async def refresh(self) -> None:
        """Show the diagnosis of the version looked at."""
        self._show_findings()
        self._show_list()
        await self.explain(self._effect or self._strongest())

    def repaint(self) -> None:
        """Draw the figures in the present look."""
        for plot in self._plots:
            plot.repaint()

    def _strongest(self) -> str:
        state = self._session.state
        found = (state.diagnosis if state else None) or {'findings': []}
        names = [f['name'] for f in found['findings'] if f['kind'] == 'effect']
        known = [name for name in names if name in self._session.effects]
        return known[0] if known else ''

    def _show_findings(self) -> None:
        self._findings.clear()
        state = self._session.state
        with self._findings:
            ui.html('<h2>Diagnosis</h2>', sanitize=False)
            if state is None or state.version is None:
                ui.label(self._session.nothing_yet).classes('soft')
                return
            found = state.diagnosis
            if found is None:
                ui.label(
                    'Searches the residual of this version for every effect of the catalogue, '
                    'held out cycle by cycle.'
                ).classes('soft')
                ui.button('Diagnose', on_click=self._actions.diagnose).props('no-caps unelevated')
                return
            ui.label(VERDICTS[found['verdict']].capitalize() + '.').classes(
                f'verdict {found["verdict"]}'
            )
            for number, finding in enumerate(found['findings'], 1):
                self._show_finding(number, finding)
            for text in (*found['undetermined'], *found['notes']):
                ui.label(text).classes('note')

    def _show_finding(self, number: int, finding: Mapping[str, Any]) -> None:
        name = finding['name'] or finding['kind']
        with ui.element('article').classes('finding'):
            ui.html(
                f'<h3><span class="rank">{number}</span> {escape(name.replace("_", " "))} '
                f'<span class="soft">in the {escape(finding["sensor"])}</span></h3>',
                sanitize=False,
            )
            ui.label(finding_text(finding)).classes('soft')
            ui.html(finding_html(finding), sanitize=False)
            with ui.row().classes('actions'):
                if finding['kind'] == 'effect' and finding['name'] in self._session.effects:
                    ui.button('Explain', on_click=lambda: self.explain(finding['name'])).props(
                        'no-caps outline'
                    )
                    sensors = finding['sensor'].split('+') if finding['sensor'] != 'all' else []
                    ui.button(
                        'Add to the model',
                        on_click=lambda: self._actions.add(finding['name'], sensors),
                    ).props('no-caps unelevated')
                for rival in finding['ambiguous_with']:
                    ui.button(
                        f'Next experiment: or {rival.replace("_", " ")}?',
                        on_click=lambda _, rival=rival: self._plan(finding['name'], rival),
                    ).props('no-caps outline')

    def _show_list(self) -> None:
        self._list.clear()
        state = self._session.state
        unusable = state.unusable if state else {}
        version = state.version if state else None
        inside = {e for names in version.effects.values() for e in names} if version else set()
        with self._list:
            ui.html('<h2>All effects</h2>', sanitize=False)
            for kind, title in (
                ('device', 'Of the device, compensated in the field'),
                ('campaign', 'Of chamber, fixture and session, only fitted'),
            ):
                ui.html(f'<h3>{title}</h3>', sanitize=False)
                with ui.element('div').classes('chips'):
                    for name, effect in self._session.effects.items():
                        if effect['kind'] != kind:
                            continue
                        reason = unusable.get(name, '')
                        look = ' grey' if reason else ' on' if name in inside else ''
                        button = ui.element('button').classes(f'chip{look}')
                        button.props('type=button')
                        if reason:
                            button.props(f'title="{escape(reason)}"')
                        button.on('click', lambda _, name=name: self.explain(name))
                        with button:
                            mark = '✓ ' if name in inside else ''
                            ui.label(mark + name.replace('_', ' '))
                            if reason:
                                ui.label(reason).classes('reason')

    async def explain(self, name: str) -> None:
        """Explain an effect and draw what it would explain of the residual."""
        self._effect = name
        self._explanation.clear()
        self._plots = []
        state, view = self._session.state, self._session.view
        with self._explanation:
            if name not in self._session.effects:
                ui.html('<h2>Explanation</h2>', sanitize=False)
                ui.label('Choose a finding or an effect to see what it means.').classes('soft')
                return
            told = self._session.effects[name]
            ui.html(f'<h2>{escape(name.replace("_", " "))}</h2>', sanitize=False)
            ui.html(explanation_html(told), sanitize=False)
            self._show_look_alikes(name, told['look_alikes'])
            place = ui.element('div').classes('preview')
        if state is None or state.version is None:
            return
        version = state.version
        sensor = view.sensor if view.sensor in told['sensors'] else told['sensors'][0]
        reason = state.unusable.get(name)
        with place:
            if reason:
                ui.label(f'It cannot be fitted to these runs: {reason}.').classes('note')
                return
            title = f'What it would explain in these data ({sensor}, {view.axis_name})'
            ui.html(f'<h3>{title}</h3>', sanitize=False)
        found = await self._actions.preview(name, sensor)
        if found is None or self._effect != name or self._session.version is not version:
            return
        with place:
            ui.html(preview_html(found, view.axis), sanitize=False)
            plot = Plot(self._look, title)
            at = view if view.sensor == sensor else type(view)(sensor, view.axis)
            plot.show(preview_figure(found, version, at, timeline_of(state.bags)))
            self._plots = [plot]

    def _show_look_alikes(self, name: str, rivals: Sequence[str]) -> None:
        for rival in rivals:
            if rival not in self._session.effects:
                continue
            with ui.element('div').classes('rival'):
                ui.label(f'Looks like {rival.replace("_", " ")}')
                for label, act in (
                    ('Explain', lambda _, rival=rival: self.explain(rival)),
                    ('Which experiment tells them apart?',
                     lambda _, rival=rival: self._plan(name, rival)),
                ):  # fmt: skip
                    button = ui.element('button').classes('chip').props('type=button')
                    button.on('click', act)
                    with button:
                        ui.label(label)

    async def _plan(self, name: str, rival: str) -> None:
        proposal = await self._actions.next_profile(name, rival)
        if proposal is None:
            return
        self._explanation.clear()
        with self._explanation:
            ui.html('<h2>Next experiment</h2>', sanitize=False)
            ui.html(proposal_html(proposal), sanitize=False)
            plot = Plot(self._look, 'Set-point of the next experiment')
            plot.show(profile_figure(proposal['setpoint']))
            self._plots = [plot]
            file = f'{name}_or_{rival}.yaml'
            ui.button(
                'Save the profile',
                on_click=lambda: ui.download.content(proposal['profile'], file),
            ).props('no-caps unelevated')


ERROR_BARS = {
    'held-out error before': 'error_before',
    'held-out error after': 'error_after',
    'noise floor': 'noise_floor',
}
"""Label → key of a finding."""


def finding_html(finding: Mapping[str, Any]) -> str:
    """Return evidence, errors, parameters and rivals of a finding as a table."""
    rows = [('evidence', evidence_text(finding['evidence'], finding['threshold']))]
    if finding['probability'] is not None:
        rows.insert(0, ('probability', percent(finding['probability'])))
    sensor, bars = finding['sensor'].split('+')[0], ''
    if finding['error_after'] is not None and sensor in DISPLAY_UNITS:
        unit = DISPLAY_UNITS[sensor]
        bars = error_bars_html(
            {
                label: None if finding[key] is None else finding[key] * unit.factor
                for label, key in ERROR_BARS.items()
            },
            unit.unit,
        )
    for name, value in finding['parameters'].items():
        text = parameter_text(value['value'], value.get('std'))
        rows.append((name.replace('_', ' '), f'{text} {value["unit"]}'))
    if finding['rivals']:
        text = ', '.join(
            f'{r["name"].replace("_", " ")} {percent(r["probability"])}'
            for r in finding['rivals'][:3]
        )
        rows.append(('in its place', text))
    return bars + pairs_html(rows)


def evidence_text(evidence: float, threshold: float) -> str:
    """Return the evidence, and what is needed where that is known."""
    needed = f' (needed {fixed(threshold, 0)})' if threshold > 0.0 else ''
    return f'{fixed(evidence, 0)}{needed}'


def percent(share: float) -> str:
    """Return a share in percent."""
    return f'{fixed(100.0 * share, 0)}\N{NARROW NO-BREAK SPACE}%'


def finding_text(finding: Mapping[str, Any]) -> str:
    """Return the finding's sentence with names as people write them."""
    text = str(finding['text'])
    for name in (finding['name'], *finding['ambiguous_with']):
        if name:
            text = text.replace(name, name.replace('_', ' '))
    return text


def error_bars_html(values: Mapping[str, float | None], unit: str) -> str:
    """Return held-out error before, after, and the floor as bars on a logarithmic scale."""
    known = [value for value in values.values() if value and value > 0.0]
    if not known:
        return ''
    low, high = min(known) / 3.0, max(known)
    rows = ''
    for label, value in values.items():
        share = 100.0 * log(max(value or low, low) / low) / log(high / low)
        kind = label.rpartition(' ')[2]
        rows += (
            f'<span class="label">{label}</span><span class="line {kind}">'
            f'<span style="width:{share:.0f}%"></span></span>'
            f'<span class="number">{shown(value)} {unit}</span>'
        )
    return f'<div class="error-bars">{rows}</div>'


def explanation_html(told: Mapping[str, Any]) -> str:
    """Return an effect in words."""
    rows = [
        ('mechanism', told['mechanism']),
        ('to tell it apart', told['separation']),
        ('typical size', told['typical_size']),
        ('acts on', ', '.join(told['sensors'])),
        ('needs', ', '.join(told['channels']) or 'nothing beyond temperature and time'),
        ('reference', told['reference']),
    ]
    return (
        f'<p>{escape(told["summary"])}</p><p class="equation">{escape(told["equation"])}</p>'
        + pairs_html(rows)
    )


def preview_html(found: EffectPreview, axis: int) -> str:
    """Return in a sentence what the effect would explain."""
    shape = ', '.join(
        f'{name.replace("_", " ")} {parameter_text(value["value"], None)} {value["unit"]}'
        for name, value in found.parameters.items()
    )
    return (
        f'<p>Evidence {evidence_text(found.evidence, found.threshold)}; explains '
        f'{percent(found.share[axis])} of the variance of the residual of this axis'
        f'{"; " + escape(shape) if shape else ""}.</p>'
    )


def proposal_html(proposal: Mapping[str, Any]) -> str:
    """Return what the next experiment promises."""
    one, other = (name.replace('_', ' ') for name in proposal['effects'])
    before, after = proposal['evidence_before'], proposal['evidence_after']
    evidence = (
        f'{shown(before)} with the plan of the paper, {shown(after)} with this one '
        f'(needed {fixed(SEPARATING_EVIDENCE, 0)})'
    )
    verdict = 'separable' if proposal['separable'] else 'not separable by temperature alone'
    rows = [
        ('question', f'{one} or {other} in the {proposal["sensor"]}'),
        ('answer', verdict),
        ('evidence', evidence),
        ('length', f'{proposal["repeats"]} cycles, {proposal["hours"]:.1f} h a run'),
        *(('do', action) for action in proposal['actions']),
    ]  # fmt: skip
    return pairs_html(rows)


def pairs_html(rows: list[tuple[str, str]]) -> str:
    """Return names and values as a list."""
    items = ''.join(f'<dt>{escape(name)}</dt><dd>{escape(text)}</dd>' for name, text in rows)
    return f'<dl class="pairs">{items}</dl>'
