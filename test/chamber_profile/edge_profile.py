# SPDX-License-Identifier: Apache-2.0
"""A profile at the edges of what one may hold."""

from chamber_profile.profile.file import parse_profile

EDGE = parse_profile("""\
schema: 1
name: edge
limits: {air_min_c: 5.03, air_max_c: 30.06, device_max_c: 60, rate_max_c_per_min: 4}
steps:  # up to limits that no set-point can express, and every way to settle and to dwell
  - {id: begin, kind: precondition, target_c: 20, rate_c_per_min: 3, dwell_s: 60}
  - {id: heat, kind: ramp, target_c: 30.06, rate_c_per_min: 4}
  - {id: hot, kind: dwell, dwell_s: 200, dwell_mode: restart,
     stabilise: {band_c: 0.4, hold_s: 30, timeout_s: 900, on_timeout: hold}}
  - {id: cool, kind: ramp, target_c: 5.03, rate_c_per_min: 2}
  - {id: cold, kind: dwell, dwell_s: 100, dwell_mode: free,
     stabilise: {source: device, band_c: 1, hold_s: 20, timeout_s: 200, on_timeout: continue}}
  - {id: look, kind: operator, prompt: Look at it.}
  - {id: warm, kind: ramp, target_c: 25, rate_c_per_min: 1.5}
  - {id: end, kind: dwell, dwell_s: 100, stabilise: {band_c: 0.3, hold_s: 100, timeout_s: 150}}
on_abort: {target_c: 22, rate_c_per_min: 1, timeout_s: 300}
""")
