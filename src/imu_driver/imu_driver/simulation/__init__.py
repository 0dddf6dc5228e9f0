# SPDX-License-Identifier: Apache-2.0
"""Physics of a simulated device, finer than and independent of thermal_comp's catalogue.

`devices` → `run` (heat, slow errors) → `hidden` (adds one hidden effect or fault) → `read_out`.
"""
