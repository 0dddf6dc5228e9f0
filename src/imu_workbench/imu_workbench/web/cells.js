// SPDX-License-Identifier: Apache-2.0
// Cells of a map for the keyboard: laid over the plot wherever it is drawn; arrow keys move.
window.layCells = () => {
  for (const map of document.querySelectorAll('.map')) {
    const size = map.querySelector('.js-plotly-plot')?._fullLayout?._size;
    const cells = map.querySelector('.cells');
    if (!size || !cells) continue;
    Object.assign(cells.style, {
      left: `${size.l}px`, top: `${size.t}px`, width: `${size.w}px`, height: `${size.h}px`,
    });
  }
};

const STEPS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };

// The nearest cell of the next row or column that has any: no cell is out of reach.
const nextCell = (grid, cell, key) => {
  const rows = [...grid.children].map((row) => [...row.children]);
  let row = rows.findIndex((cells) => cells.includes(cell));
  let column = rows[row].indexOf(cell);
  const own = rows[row].filter((other) => other.matches('button'));
  if (key === 'Home') return own[0];
  if (key === 'End') return own[own.length - 1];
  const [down, right] = STEPS[key];
  for (;;) {
    row += down;
    column += right;
    const line = down ? rows[row] : rows.map((cells) => cells[column]);
    if (!line?.some(Boolean)) return undefined;
    const from = down ? column : row;
    const near = line.filter((other) => other?.matches('button'));
    near.sort((a, b) => Math.abs(line.indexOf(a) - from) - Math.abs(line.indexOf(b) - from));
    if (near.length > 0) return near[0];
  }
};

document.addEventListener('keydown', (event) => {
  const cell = event.target.closest?.('.cells button');
  if (!cell || !(event.key in STEPS || event.key === 'Home' || event.key === 'End')) return;
  event.preventDefault();
  nextCell(cell.closest('.cells'), cell, event.key)?.focus();
});

document.addEventListener('focusin', (event) => {
  const cell = event.target.closest?.('.cells button');
  if (!cell) return;
  for (const other of cell.closest('.cells').querySelectorAll('button')) other.tabIndex = -1;
  cell.tabIndex = 0;
});
