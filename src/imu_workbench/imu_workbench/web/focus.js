// SPDX-License-Identifier: Apache-2.0
// After a key press a part of the page may be drawn anew: the focus goes to the new button with the
// same action, or, where there is none, to the first button of that part.
const FOCUS_TIMEOUT_MS = 3000;
let pressed = null;

window.addEventListener('keydown', (event) => {
  const { key, target } = event;
  const button = key === 'Enter' || key === ' ' ? target.closest?.('[data-act]') : null;
  if (!button) return;
  pressed = { act: button.dataset.act, part: button.closest('[data-acts]'), at: Date.now() };
  if (key !== 'Enter') return;
  // Quasar's buttons act on keyup: a button drawn anew before that would not act at all.
  event.preventDefault();
  event.stopImmediatePropagation();
  if (!event.repeat) button.click();
}, true); // capturing: Quasar's buttons stop the event
document.addEventListener('pointerdown', () => { pressed = null; });
document.addEventListener('focusin', ({ target }) => {
  if (target.dataset?.act !== pressed?.act) pressed = null;
});

const sameButton = () => document.querySelector(`[data-act="${CSS.escape(pressed.act)}"]`)
  ?? (Date.now() - pressed.at < FOCUS_TIMEOUT_MS ? pressed.part?.querySelector('[data-act]') : null);

document.addEventListener('DOMContentLoaded', () => {
  new MutationObserver(() => {
    if (pressed && document.activeElement === document.body) sameButton()?.focus({ preventScroll: true });
  }).observe(document.body, { childList: true, subtree: true });
});
