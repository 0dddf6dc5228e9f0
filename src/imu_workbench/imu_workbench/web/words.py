# SPDX-License-Identifier: Apache-2.0
"""Technical words on the page with their explanation, the one `explain` gives."""

from __future__ import annotations

from html import escape

from thermal_comp.presentation.words import WORDS

KEYS = {
    'noise': 'noise_floor',
    'noise floor': 'noise_floor',
    'held out': 'held_out_rms',
    'held-out error': 'held_out_rms',
    'evidence': 'evidence',
    'probability': 'probability',
    'empirical': 'prediction',
    'block means': 'block',
}
"""What the page says → its entry in WORDS."""
OWN = {
    'prediction': 'The cause is undecided: the effect only lowers the error on parts of the runs '
    'the fit has not seen. It corrects runs like these and says nothing of the physics.',
}
"""Words that only the page has."""


def word(text: str) -> str:
    """Return HTML of a word that explains itself: to a pointer, a finger and the keyboard."""
    key = KEYS[text]
    meaning = OWN.get(key) or WORDS[key]
    return (
        f'<span class="word" tabindex="0">{escape(text)}'
        f'<span class="meaning" role="tooltip">{escape(meaning)}</span></span>'
    )
