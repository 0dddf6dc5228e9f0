// SPDX-License-Identifier: Apache-2.0
// One cursor through all figures: a moment under the pointer in one lights up in the others.
const plotNamed = (name) => document.querySelector(`.js-plotly-plot[data-plot="${name}"]`);
const CURSORS = { error_over_time: 'hours', residual_by_temperature: 'temperature', residual_by_rate: 'rate' };

const nearestRow = (rows, point, column) => {
  let best = -1;
  let least = Infinity;
  const span = (values) => Math.max(...values) - Math.min(...values) || 1;
  rows.spans ??= Object.fromEntries(
    ['hours', 'temperature', 'rate', 'residual'].map((key) => [key, span(rows[key].filter((v) => v !== null))]));
  for (let i = 0; i < rows.hours.length; i += 1) {
    if (rows.residual[i] === null) continue;
    const across = (rows[column][i] - point.x) / rows.spans[column];
    const up = column === 'hours' ? 0 : (rows.residual[i] - point.y) / rows.spans.residual;
    const distance = across * across + up * up;
    if (distance < least) { least = distance; best = i; }
  }
  return best;
};

const markRow = async (rows, index) => {
  const { Plotly } = await import('nicegui-plotly');
  for (const [name, column] of Object.entries(CURSORS)) {
    const plot = plotNamed(name);
    const trace = plot?.data?.findIndex((one) => one.name === 'cursor') ?? -1;
    if (trace < 0) continue;
    const x = index < 0 ? null : rows[column][index];
    const y = index < 0 ? null : rows.residual[index];
    Plotly.restyle(plot, { x: [[x]], y: [[y]] }, [trace]);
  }
  for (const cell of document.querySelectorAll('.cells button.under')) cell.classList.remove('under');
  if (index >= 0) {
    document.querySelector(`.cells button[data-cell="${CSS.escape(rows.cell[index])}"]`)
      ?.classList.add('under');
  }
};

let cursorWanted = null;
window.linkCursor = (name, event) => {
  const rows = plotNamed('error_over_time')?.layout?.meta;
  const point = event?.points?.[0];
  if (!rows?.hours) return;
  const waiting = cursorWanted !== null;
  cursorWanted = point ? nearestRow(rows, point, CURSORS[name]) : -1;
  if (waiting) return;
  requestAnimationFrame(() => { const index = cursorWanted; cursorWanted = null; markRow(rows, index); });
};
