# SPDX-License-Identifier: Apache-2.0
"""Thermal test profiles: what the chamber shall do, read from YAML, checked and unrolled."""
