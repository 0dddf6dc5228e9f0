# SPDX-License-Identifier: Apache-2.0
"""Style of the live view; colours follow the page's text colour, so both themes work."""

STYLE = """
.live-grid { display: grid; gap: 12px; width: 100%;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 380px), 1fr)); }
.live-body { width: 100%; display: grid; gap: 12px; }
.live-tall { height: 330px; }
.live-table caption { display: none; }
.live-topics td:last-child { text-align: left; white-space: normal; overflow-wrap: anywhere; }
.live-topics th:last-child { text-align: left; }
.live-wide { grid-column: span 2; }
@media (max-width: 840px) { .live-wide { grid-column: auto; } }
.live-boards { display: grid; grid-template-columns: 1fr 1fr; width: 100%; }
.live-boards svg { width: 100%; height: auto; max-height: 250px; }
.live-scroll { overflow-x: auto; max-width: 100%; width: 100%; }
.live-device { min-width: 9rem; }
.live-controls .q-field { min-width: 7.5rem; }
.live-tiles dl { display: flex; flex-wrap: wrap; gap: 6px 22px; margin: 0; }
.live-tiles dt { font-size: 12px; opacity: 0.75; }
.live-tiles dd { margin: 0; font-size: 17px; font-variant-numeric: tabular-nums; }
.live-message { font-weight: 500; }
.live-table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
.live-table th, .live-table td { padding: 2px 8px; text-align: right; white-space: nowrap; }
.live-table th[scope=row], .live-table th:first-child { text-align: left; font-weight: 500; }
.live-table tbody tr { border-top: 1px solid rgba(128, 140, 155, 0.3); }
.live-warning .q-item__label { border-left: 4px solid #e69f00; padding-left: 6px; }
.live-error .q-item__label { border-left: 4px solid #d55e00; padding-left: 6px; }
.live-stale .q-item__label { border-left: 4px solid #8b95a3; padding-left: 6px; }
.live-ok .q-item__label { border-left: 4px solid #009e73; padding-left: 6px; }
"""
