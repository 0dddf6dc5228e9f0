// SPDX-License-Identifier: Apache-2.0
// A plot on a page that is not shown has no size; plotly.js refuses to be resized then. Observers
// of plots are told only of plots that are on the screen.
const PlainObserver = window.ResizeObserver;
const isShown = (element) =>
  !element.classList.contains('js-plotly-plot') || element.getClientRects().length > 0;
window.ResizeObserver = class extends PlainObserver {
  constructor(callback) {
    super((entries, observer) => {
      const shown = entries.filter((entry) => isShown(entry.target));
      if (shown.length > 0) callback(shown, observer);
    });
  }
};
