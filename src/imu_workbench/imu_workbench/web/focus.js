// SPDX-License-Identifier: Apache-2.0
// A key pressed on a button may have its part drawn anew: the button that does the same has the
// focus then; where there is none any more, the first of its part.
const PART_PATIENCE_MS = 3000;
let pressed = null;

window.addEventListener('keydown', (event) => {
  const { key, target } = event;
  const button = key === 'Enter' || key === ' ' ? target.closest?.('[data-act]') : null;
  if (!button) return;
  pressed = { act: button.dataset.act, part: button.closest('[data-acts]'), at: Date.now() };
  if (key !== 'Enter') return;
  // Quasar's buttons act when the key rises: drawn anew until then, they would forget it.
  event.preventDefault();
  event.stopImmediatePropagation();
  if (!event.repeat) button.click();
}, true); // Quasar's buttons pass on no key
document.addEventListener('pointerdown', () => { pressed = null; });
document.addEventListener('focusin', ({ target }) => {
  if (target.dataset?.act !== pressed?.act) pressed = null;
});

const sameButton = () => document.querySelector(`[data-act="${CSS.escape(pressed.act)}"]`)
  ?? (Date.now() - pressed.at < PART_PATIENCE_MS ? pressed.part?.querySelector('[data-act]') : null);

document.addEventListener('DOMContentLoaded', () => {
  new MutationObserver(() => {
    if (pressed && document.activeElement === document.body) sameButton()?.focus({ preventScroll: true });
  }).observe(document.body, { childList: true, subtree: true });
});
