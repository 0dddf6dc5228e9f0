# SPDX-License-Identifier: Apache-2.0
"""An effect in words, and the experiment that tells two effects apart, as dialogs."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from nicegui import ui
from thermal_comp.effects.explanation import needed_channels
from thermal_comp.experiment.design import SEPARATING_EVIDENCE
from thermal_comp.presentation.display import DISPLAY_UNITS, fixed, shown

from imu_workbench.web.case.next_experiment import profile_figure
from imu_workbench.web.plot import Look, Plot


class ExplainDialog:
    """What is known about one effect."""

    def __init__(self) -> None:
        with ui.dialog().props('aria-label="Effect"') as self._dialog:
            self._place = ui.element('div').classes('card dialog')

    def show(self, told: Mapping[str, Any]) -> None:
        """Explain an effect."""
        self._place.clear()
        with self._place:
            ui.html(f'<h2>{escape(told["name"].replace("_", " "))}</h2>', sanitize=False)
            ui.html(explanation_html(told), sanitize=False)
            with ui.row().classes('actions'):
                ui.button('Done', on_click=self._dialog.close).props('no-caps unelevated')
        self._dialog.open()


class ExperimentDialog:
    """The next experiment as text and picture, to be saved as a profile."""

    def __init__(self, look: Look) -> None:
        self._look = look
        with ui.dialog().props('aria-label="Next experiment"') as self._dialog:
            self._place = ui.element('div').classes('card dialog wide-dialog')

    def show(self, proposal: Mapping[str, Any]) -> None:
        """Show a proposal."""
        one, other = proposal['effects']
        self._place.clear()
        with self._place:
            ui.html('<h2>Next experiment</h2>', sanitize=False)
            ui.html(proposal_html(proposal), sanitize=False)
            plot = Plot(self._look, 'Set-point of the next experiment', 'next_experiment')
            plot.show(profile_figure(proposal['setpoint']))
            with ui.row().classes('actions'):
                ui.button(
                    'Save the profile',
                    on_click=lambda: ui.download.content(
                        proposal['profile'], f'{one}_or_{other}.yaml'
                    ),
                ).props('no-caps unelevated')
                ui.button('Done', on_click=self._dialog.close).props('no-caps flat')
        self._dialog.open()


def explanation_html(told: Mapping[str, Any]) -> str:
    """Return an effect in words."""
    rows = [
        ('mechanism', told['mechanism']),
        ('looks like', ', '.join(name.replace('_', ' ') for name in told['look_alikes'])),
        ('to tell it apart', told['separation']),
        ('typical size', told['typical_size']),
        ('acts on', ', '.join(told['sensors'])),
        ('needs', needed_channels(told) or 'nothing beyond temperature and time'),
        ('reference', told['reference']),
    ]
    return (
        f'<p>{escape(told["summary"])}</p><p class="equation">{escape(told["equation"])}</p>'
        + pairs_html([(name, text) for name, text in rows if text])
    )


def proposal_html(proposal: Mapping[str, Any]) -> str:
    """Return what the next experiment promises."""
    one, other = (name.replace('_', ' ') for name in proposal['effects'])
    before, after = proposal['evidence_before'], proposal['evidence_after']
    evidence = (
        f'{shown(before)} with the plan of Betta et al. 2022, {shown(after)} with this one '
        f'(needed {fixed(SEPARATING_EVIDENCE, 0)})'
    )
    unit, missing = DISPLAY_UNITS[proposal['sensor']], proposal['missing']
    size = (
        f'what is missing now, {shown(missing * unit.factor)} {unit.unit} rms'
        if missing
        else ('M = 1, as large as the noise of a mean over a second')
    )
    verdict = 'separable' if proposal['separable'] else 'not separable by temperature alone'
    rows = [
        ('question', f'{one} or {other} in the {proposal["sensor"]}'),
        ('answer', verdict),
        ('assumed size', size),
        ('evidence', evidence),
        ('length', f'{proposal["repeats"]} cycles, {proposal["hours"]:.1f} h a run'),
        *(('do', action) for action in proposal['actions']),
    ]  # fmt: skip
    return pairs_html(rows)


def pairs_html(rows: list[tuple[str, str]]) -> str:
    """Return names and values as a list."""
    items = ''.join(f'<dt>{escape(name)}</dt><dd>{escape(text)}</dd>' for name, text in rows)
    return f'<dl class="pairs">{items}</dl>'
