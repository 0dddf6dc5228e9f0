// SPDX-License-Identifier: Apache-2.0
// Tells the server of the window's width, the theme and the address; keeps the tab's name.
window.watchLook = (phone) => {
  const narrow = matchMedia(`(max-width: ${phone - 0.02}px)`);
  const dark = matchMedia('(prefers-color-scheme: dark)');
  narrow.addEventListener('change', () => emitEvent('narrow', narrow.matches));
  dark.addEventListener('change', () => emitEvent('dark', dark.matches));
  window.addEventListener('popstate', () => emitEvent('went', location.search));
  const name = sessionStorage.getItem('tab') || String(Math.random()).slice(2);
  sessionStorage.setItem('tab', name); // the same after a reload
  const theme = localStorage.getItem('theme'); // chosen before a reload; null: the system's
  if (theme) chooseTheme(theme === 'dark');
  const isDark = theme ? theme === 'dark' : dark.matches;
  const coarse = matchMedia('(pointer: coarse)').matches;
  return [isDark, narrow.matches, coarse, name, Boolean(theme)];
};

// NiceGUI's element for it sets the theme with every change of the page: all styles are computed anew.
window.chooseTheme = (dark) => {
  localStorage.setItem('theme', dark ? 'dark' : 'light');
  Quasar.Dark.set(dark);
  document.getElementById('nicegui-color-scheme').content = dark ? 'dark' : 'light';
};

// Puts what is looked at into the address: a step that "back" goes back, or only a correction.
window.showAddress = (query, step) => {
  if (query === location.search || (query === '?' && !location.search)) return;
  history[step ? 'pushState' : 'replaceState'](null, '', location.pathname + query);
};
