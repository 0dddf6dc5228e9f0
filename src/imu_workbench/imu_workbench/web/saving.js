// SPDX-License-Identifier: Apache-2.0
// Saves a figure as SVG or PNG, or its numbers as CSV, under a name that says what it shows.
const csvField = (value) => (/[",\n]/.test(value) ? `"${value.replaceAll('"', '""')}"` : value);

const csvOf = (plot) => {
  const layout = plot._fullLayout;
  const titled = (name) => layout[name]?.title?.text?.replaceAll('<br>', ' ') || '';
  // Of stacked panels only the lowest says what its x is.
  const title = (name) => titled(name)
    || Object.keys(layout).filter((key) => key.startsWith(name.slice(0, 5))).map(titled).find(Boolean)
    || name[0];
  const named = (axis, value) => {
    const at = axis?.ticktext && axis.tickvals?.indexOf(Math.round(value));
    return at >= 0 ? axis.ticktext[at].replaceAll('<br>', ' ') : value;
  };
  // Where runs stand one after the other, a row says which one it is of.
  const { runs, starts } = plot.layout.meta ?? {};
  const runAt = (x) => runs[Math.max(starts.findLastIndex((start) => start <= x), 0)];
  const lines = [`curve,x,y,x is,y is${runs ? ',run' : ''}`];
  for (const trace of plot.data) {
    if (trace.hoverinfo === 'skip') continue; // the cursor, numbers of cells
    const names = [trace.xaxis || 'x', trace.yaxis || 'y'].map((a) => `${a[0]}axis${a.slice(1)}`);
    const map = trace.type === 'heatmap';
    const axes = map ? ['place', 'residual in noise floors'] : names.map(title);
    const rows = map
      ? trace.text.flatMap((row, i) => row.map((v, j) => [trace.customdata[i][j], v]))
      : Array.from(trace.x, (x, i) => [named(layout[names[0]], x), trace.y[i]]);
    for (const [x, y] of rows) {
      if (x === null || y === null || y === '') continue;
      const row = [trace.name || plot.dataset.plot, x, y, ...axes, ...(runs ? [runAt(x)] : [])];
      lines.push(row.map((v) => csvField(String(v))).join(','));
    }
  }
  return `${lines.join('\n')}\n`;
};

document.addEventListener('click', async (event) => {
  const button = event.target.closest?.('button[data-save]');
  const plot = button?.closest('.card')?.querySelector('.js-plotly-plot');
  if (!plot?._fullLayout) return;
  const stem = button.closest('[data-stem]')?.dataset.stem;
  const filename = [stem, plot.dataset.plot].filter(Boolean).join('_');
  if (button.dataset.save !== 'csv') {
    const { Plotly } = await import('nicegui-plotly');
    const { width, height } = plot._fullLayout;
    Plotly.downloadImage(plot, { format: button.dataset.save, filename, width, height, scale: 2 });
    return;
  }
  const link = document.createElement('a');
  link.href = URL.createObjectURL(new Blob([csvOf(plot)], { type: 'text/csv' }));
  link.download = `${filename}.csv`;
  link.click();
  URL.revokeObjectURL(link.href);
});
