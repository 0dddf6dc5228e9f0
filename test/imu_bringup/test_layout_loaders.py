# SPDX-License-Identifier: Apache-2.0
"""The layouts keep what the loaders of PlotJuggler and Foxglove ask of a file."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

LAYOUTS = Path(__file__).resolve().parents[2] / 'src' / 'imu_bringup' / 'layouts'


def restored(splitter: ET.Element) -> list[str]:
    """Return the names of the plots as PlotJuggler restores them: `count` places, in order."""
    children = list(splitter)
    places = int(splitter.get('count'))
    names: list[str] = []
    for child in children[:places]:
        names += restored(child) if child.tag == 'DockSplitter' else [child.get('name')]
    return names


def test_plotjuggler_restores_every_plot(plotjuggler: ET.Element) -> None:
    widget = plotjuggler.find('tabbed_widget')
    assert (widget.get('parent'), widget.get('name')) == ('main_window', 'Main Window')
    tabs = widget.findall('Tab')
    assert 0 <= int(widget.find('currentTabIndex').get('index')) < len(tabs)
    for tab in tabs:
        areas = [area.get('name') for area in tab.iter('DockArea')]
        assert restored(tab.find('Container/DockSplitter')) == areas
    for plot in plotjuggler.iter('plot'):
        assert plot.get('mode') == 'TimeSeries'
        assert plot.get('style') in ('Lines', 'Dots', 'LinesAndDots', 'Sticks', 'Steps')
        assert {plot.get('flip_x'), plot.get('flip_y')} <= {'true', 'false'}
        curves = [curve.get('name') for curve in plot.findall('curve')]
        assert curves
        assert len(set(curves)) == len(curves)
        assert all(re.fullmatch('#[0-9a-f]{6}', c.get('color')) for c in plot.findall('curve'))


def test_plotjuggler_equations_use_what_they_are_given(plotjuggler: ET.Element) -> None:
    for snippet in plotjuggler.iterfind('customMathEquations/snippet'):
        given = [source.tag for source in snippet.find('additional_sources')]
        assert given == [f'v{i}' for i in range(1, len(given) + 1)]  # read until one is missing
        used = set(re.findall(r'[a-z]\w*', snippet.findtext('function'))) - {'return'}
        assert used == {'value', *given}
        assert snippet.get('language', 'lua') == 'lua'


PATH = re.compile(
    r'(/[\w-]+)+'  # topic
    r'(\.[\w-]+(\[:\])?(\{[\w.]+=="[^"]*"\})?)+'  # fields, slices, filters
    r'(\.@rad2deg)?'  # the one modifier used here
)
PANELS = {
    '3D': {'cameraState', 'followMode', 'followTf', 'scene', 'transforms', 'topics', 'layers',
           'imageMode'},
    'Plot': {'title', 'paths', 'showLegend', 'legendDisplay', 'showPlotValuesInLegend',
             'showXAxisLabels', 'showYAxisLabels', 'isSynced', 'xAxisVal', 'followingViewWidth',
             'sidebarDimension', 'yAxisLabel'},
    'StateTransitions': {'paths', 'isSynced'},
    'DiagnosticSummary': {'minLevel', 'pinnedIds', 'hardwareIdFilter', 'topicToRender',
                          'sortByLevel'},
    'DiagnosticStatusPanel': {'topicToRender', 'collapsedSections'},
    'Parameters': {'title'},
    'Tab': {'activeTabIdx', 'tabs'},
}  # fmt: skip
"""Panel types that Foxglove registers, and what each reads of its configuration."""


def test_foxglove_reads_every_key_of_the_layout(foxglove: dict[str, Any]) -> None:
    assert set(foxglove) == {
        'configById', 'globalVariables', 'userNodes', 'playbackConfig', 'layout',
    }  # fmt: skip
    for panel, config in foxglove['configById'].items():
        kind, _, number = panel.partition('!')
        assert number
        assert set(config) - {'foxglovePanelTitle'} <= PANELS[kind], panel
        for tab in config.get('tabs', []):
            assert set(tab) == {'title', 'layout'}
        for path in config.get('paths', []):
            assert PATH.fullmatch(path['value']), path['value']
            assert path['timestampMethod'] in ('receiveTime', 'headerStamp')
            assert re.fullmatch('#[0-9a-f]{6}', path.get('color', '#000000'))
        if kind == 'Plot':
            assert (config['xAxisVal'], config['legendDisplay']) == ('timestamp', 'floating')
            assert config['yAxisLabel'] in config['title'] or len(config['paths']) > 2, panel
