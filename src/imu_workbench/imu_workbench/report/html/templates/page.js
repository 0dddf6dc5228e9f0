// Plotting library and figures are kept compressed in the page; nothing is fetched.
function unpack(id) {
  const packed = atob(document.getElementById(id).textContent);
  const bytes = Uint8Array.from(packed, (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).text();
}
let figures = null;
async function unpackAll() {
  figures = JSON.parse(await unpack('figures'));
  reserve();
  if (location.hash) document.getElementById(location.hash.slice(1))?.scrollIntoView();
  const script = document.createElement('script');
  script.textContent = await unpack('plotly');
  document.head.append(script);
}
const unpacked = unpackAll();
const narrowScreen = matchMedia('(max-width: 700px)');
const touched = matchMedia('(pointer: coarse)');
const theme = () => document.documentElement.dataset.theme;

// Colours are written as '@name' in the figures; every theme has its own value.
function painted(value, colours) {
  if (typeof value === 'string') return value.startsWith('@') ? colours[value.slice(1)] : value;
  if (Array.isArray(value)) return value.map((item) => painted(item, colours));
  if (value && typeof value === 'object') {
    const copy = {};
    for (const key of Object.keys(value)) copy[key] = key === 'bdata' ? value[key] : painted(value[key], colours);
    return copy;
  }
  return value;
}
function merged(base, over) {
  const result = { ...base };
  for (const key of Object.keys(over || {})) {
    const both = result[key] && typeof result[key] === 'object' && !Array.isArray(over[key]);
    result[key] = both ? merged(result[key], over[key]) : over[key];
  }
  return result;
}
function draw(holder) {
  if (!window.Plotly) { unpacked.then(() => draw(holder)); return; }
  const figure = figures[holder.dataset.figure];
  if (!figure) return;
  const colours = COLOURS[theme()];
  // A finger scrolls the page over a figure; the buttons above it zoom.
  const size = narrowScreen.matches ? merged(figure.layout, figure.narrow) : figure.layout;
  const layout = touched.matches ? { ...size, dragmode: false } : size;
  const bar = narrowScreen.matches ? false : touched.matches ? true : 'hover';
  const config = { responsive: true, displaylogo: false, displayModeBar: bar,
    modeBarButtonsToRemove: ['lasso2d', 'select2d', 'autoScale2d'] };
  holder.style.height = layout.height + 'px';
  Plotly.react(holder, painted(figure.data, colours), painted(layout, colours), config);
  holder.dataset.drawn = 'yes';
}
const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (entry.isIntersecting && !entry.target.dataset.drawn) draw(entry.target);
  }
}, { rootMargin: '600px' });
const holders = [...document.querySelectorAll('.plot')];
holders.forEach((holder) => seen.observe(holder));
// Every figure has its height from the start, so that a link to a section lands on it.
function reserve() {
  for (const holder of holders) {
    const figure = figures[holder.dataset.figure];
    const height = figure && ((narrowScreen.matches && figure.narrow.height) || figure.layout.height);
    if (height) holder.style.height = height + 'px';
  }
}
function redraw() { holders.filter((holder) => holder.dataset.drawn).forEach(draw); }
narrowScreen.addEventListener('change', redraw);
addEventListener('beforeprint', () => holders.forEach(draw));
document.getElementById('theme').addEventListener('click', () => {
  const next = theme() === 'dark' ? 'light' : 'dark';
  document.documentElement.dataset.theme = next;
  try { localStorage.setItem('theme', next); } catch (error) { /* a private window forgets it */ }
  redraw();
});
// Selectors of a group: each choice shows one figure and the rows or tables that belong to it.
for (const group of document.querySelectorAll('[data-group]')) {
  const selects = [...group.querySelectorAll(':scope > .controls select')];
  const choose = () => {
    const key = selects.map((select) => select.value).join('|');
    for (const part of group.querySelectorAll(':scope [data-key]')) {
      part.hidden = part.dataset.key !== key;
    }
    const plot = group.querySelector(':scope > figure > .plot');
    if (plot) {
      plot.dataset.figure = group.dataset.group + '|' + key;
      if (plot.dataset.drawn) draw(plot);
    }
  };
  selects.forEach((select) => select.addEventListener('change', choose));
  choose();
}
const links = [...document.querySelectorAll('nav a')];
const sections = links.map((link) => document.querySelector(link.getAttribute('href')));
function markSection() {
  let current = 0;
  sections.forEach((section, i) => { if (section.getBoundingClientRect().top < 140) current = i; });
  links.forEach((link, i) => link.setAttribute('aria-current', i === current ? 'true' : 'false'));
}
addEventListener('scroll', markSection, { passive: true });
markSection();
