# SPDX-License-Identifier: Apache-2.0
"""Technical words on the page with their explanation, the one `explain` gives."""

from __future__ import annotations

import re
from html import escape

from thermal_comp.presentation.words import VERDICT_SENTENCES

ENTRY_OF_WORD = {
    'noise': 'noise_floor',
    'noise floor': 'noise_floor',
    'held out': 'held_out_rms',
    'held-out error': 'held_out_rms',
    'evidence': 'evidence',
    'probability': 'probability',
    'empirical': 'prediction',
    'phase': 'phase',
    'residual': 'left',
    'allan deviation': 'allan',
    'spectrum': 'spectrum',
    'error staircase': 'staircase',
    'coefficients': 'coefficients',
}
"""Word of the page in lower case → its entry in VERDICT_SENTENCES or PAGE_WORDS."""
PAGE_WORDS = {
    'prediction': 'The cause is undecided: the effect only lowers the error on parts of the runs '
    'the fit has not seen. It corrects runs like these and says nothing of the physics.',
    'left': 'Measured minus modelled error: what the model leaves, as means over short blocks.',
    'allan': 'How much means over an averaging time differ from one to the next: it falls where '
    'noise averages out and rises where the output drifts.',
    'spectrum': 'How what is left is spread over frequencies: what stands above the noise model '
    'at the period of a thermal cycle is temperature error.',
    'staircase': 'Held-out error of each version, from no model to the one looked at; dashed: '
    'the noise floor, which no model gets below.',
    'coefficients': 'What each effect of the model is multiplied by, found from the recordings, '
    'with one standard deviation.',
}
"""Words that only the page has."""
WORD_PATTERN = re.compile(
    '|'.join(sorted(map(re.escape, ENTRY_OF_WORD), key=len, reverse=True)), re.I
)


def word(text: str, meant: str = '') -> str:
    """Return HTML of a word with its explanation, for pointer, finger and keyboard.

    `meant` is the word where the text is a number of it.
    """
    key = ENTRY_OF_WORD[(meant or text).lower()]
    meaning = PAGE_WORDS.get(key) or VERDICT_SENTENCES[key]
    return (
        f'<span class="word" tabindex="0">{escape(text)}'
        f'<span class="meaning" role="tooltip">{escape(meaning)}</span></span>'
    )


def with_help(title: str) -> str:
    """Return HTML of a title whose technical words explain themselves, each once."""
    return WORD_PATTERN.sub(lambda found: word(found.group()), title)


def spaced(text: str) -> str:
    """Return a text with the names of effects and sensors in it as words.

    >>> spaced('thermal_lag of the gyroscope')
    'thermal lag of the gyroscope'
    """
    return text.replace('_', ' ')
