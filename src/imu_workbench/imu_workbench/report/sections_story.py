# SPDX-License-Identifier: Apache-2.0
"""The section of the page that tells how a hidden effect is found and removed."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from imu_workbench.report.figures_modelled import failure_figure
from imu_workbench.report.figures_staircase import staircase_figure
from imu_workbench.report.html import Section, figure_html
from imu_workbench.report.sections_diagnosis import degrees_html
from imu_workbench.report.staircase import degree_steps


def story_section(content: Mapping[str, Any]) -> Section | None:
    """Return the story: its lines, the maps before and after, the staircase."""
    story = content.get('story')
    if not story:
        return None
    figures = {}
    body = f'<pre class="told">{escape(chr(10).join(story["lines"]))}</pre>'
    for sensor, part in story['sensors'].items():
        if part['maps']['before'] and part['maps']['after']:
            figures[f'map|{sensor}'] = failure_figure(
                {
                    'line per axis': part['maps']['before'],
                    'with the named effect': part['maps']['after'],
                }
            )
            body += figure_html(
                f'map|{sensor}',
                f'{escape(sensor.capitalize())}: residual over noise floor by phase and cycle, '
                'with the line per axis and with the named effect. The colours are those of every '
                'such map here: the calm end of the scale is noise alone.',
                f'Where the model of the {escape(sensor)} fails, before and after',
            )
    if story['sensors']:
        figures['stairs|story'] = staircase_figure(story['sensors'] | degree_steps(story))
        body += figure_html(
            'stairs|story',
            'The error after each step, in the unit of the sensor and in degrees of both filters. '
            'Dashed: the noise floor.',
            'Error after each step of the model',
        )
        body += degrees_html('', story)
    return Section('story', 'A hidden effect, found and removed', body, figures, 'Hidden effect')
