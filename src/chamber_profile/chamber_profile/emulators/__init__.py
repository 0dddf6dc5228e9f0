# SPDX-License-Identifier: Apache-2.0
"""Emulated chambers and data logger: a real protocol over simulated physics, with faults."""
