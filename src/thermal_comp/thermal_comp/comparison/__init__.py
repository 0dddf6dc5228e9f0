# SPDX-License-Identifier: Apache-2.0
"""Measured against modelled errors: how large, how far above the noise, where."""
