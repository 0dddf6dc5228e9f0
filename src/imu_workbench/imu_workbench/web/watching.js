// SPDX-License-Identifier: Apache-2.0
// Tells the server when the window becomes narrow or wide, and when the system turns dark or light.
window.watchLook = (phone) => {
  const narrow = matchMedia(`(max-width: ${phone - 0.02}px)`);
  const dark = matchMedia('(prefers-color-scheme: dark)');
  narrow.addEventListener('change', () => emitEvent('narrow', narrow.matches));
  dark.addEventListener('change', () => emitEvent('dark', dark.matches));
  return [dark.matches, narrow.matches, matchMedia('(pointer: coarse)').matches];
};
