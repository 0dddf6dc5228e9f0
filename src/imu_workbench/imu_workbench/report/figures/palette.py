# SPDX-License-Identifier: Apache-2.0
"""Colours by meaning, for a light and a dark page.

After Okabe and Ito (2008), "Color Universal Design"; what is drawn over each other is told apart
by deuteranopes too. The dark theme has lighter colours of the same hues. What was measured is
grey, the model has the text's colour, temperatures share one colour and differ by dash. Devices
and filters have six muted colours, none of them an axis's, that differ most from each other for
deuteranopes and for everybody else. Figures write '@name'; the page puts the theme's colour in.
"""

from __future__ import annotations

from typing import Any

COLOURS: dict[str, dict[str, str]] = {
    'light': {
        'x': '#0072b2',
        'y': '#d55e00',
        'z': '#009e73',
        'x_soft': '#9cc6e0',
        'y_soft': '#eebd99',
        'z_soft': '#99d8c7',
        'temperature': '#a0052f',
        'model': '#1b2430',
        'candidate': '#5b21d6',
        'raw': '#8b95a3',
        'raw_soft': '#c3cad3',
        'cold': '#56b4e9',
        'hot': '#e69f00',
        'd0': '#1b1b59',
        'd1': '#cc7a8f',
        'd2': '#6ca632',
        'd3': '#853dcc',
        'd4': '#594a1b',
        'd5': '#3289a6',
        'band': 'rgba(230,159,0,0.16)',
        'noise': 'rgba(90,102,117,0.15)',
        'text': '#1b2430',
        'soft': '#5a6675',
        'grid': '#e6eaef',
        'axis': '#b6bfca',
        'panel': 'rgba(0,0,0,0)',
        'tip': '#ffffff',
        'calm': '#e9f1f6',
        'raised': '#f0a860',
        'loud': '#8f2d00',
        'on_calm': '#1b2430',
        'on_raised': '#1b2430',
        'on_loud': '#ffffff',
    },
    'dark': {
        'x': '#5db3ea',
        'y': '#ff9a52',
        'z': '#35cfa2',
        'x_soft': '#2c5877',
        'y_soft': '#7a4a28',
        'z_soft': '#1d6450',
        'temperature': '#fdb1f6',
        'model': '#f2f5f9',
        'candidate': '#9a63ff',
        'raw': '#8794a5',
        'raw_soft': '#4a5666',
        'cold': '#7cc8f5',
        'hot': '#f2b632',
        'd0': '#ffff4d',
        'd1': '#bf397c',
        'd2': '#99ffcc',
        'd3': '#bf7c39',
        'd4': '#4d4dff',
        'd5': '#4da6ff',
        'band': 'rgba(242,182,50,0.16)',
        'noise': 'rgba(157,170,185,0.20)',
        'text': '#e6ebf1',
        'soft': '#9daab9',
        'grid': '#27323f',
        'axis': '#4a586a',
        'panel': 'rgba(0,0,0,0)',
        'tip': '#18202a',
        'calm': '#243240',
        'raised': '#a8622a',
        'loud': '#ffd0a0',
        'on_calm': '#f2f5f9',
        'on_raised': '#0d141c',
        'on_loud': '#0d141c',
    },
}

AXES = ('x', 'y', 'z')
"""Tokens of the colours of the axes, and their names."""


def device_colour(index: int) -> str:
    """Return the colour token of the index-th device."""
    return f'@d{index % 6}'


def painted(value: Any, theme: str) -> Any:
    """Return a figure with the theme's colours in place of the '@name' tokens."""
    if isinstance(value, str):
        return COLOURS[theme][value[1:]] if value.startswith('@') else value
    if isinstance(value, dict):
        return {key: painted(item, theme) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [painted(item, theme) for item in value]
    return value
