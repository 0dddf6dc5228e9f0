# SPDX-License-Identifier: Apache-2.0
"""Logs of autopilots as recordings: PX4 (ULog) and ArduPilot (DataFlash)."""
