# SPDX-License-Identifier: Apache-2.0
"""Finds, fits and removes the temperature error of MEMS IMUs, per axis and per device."""
