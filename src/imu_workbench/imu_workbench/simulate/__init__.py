# SPDX-License-Identifier: Apache-2.0
"""Simulated campaigns: a device in a chamber, with hidden effects and with motion."""
