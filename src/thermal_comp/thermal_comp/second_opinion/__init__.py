# SPDX-License-Identifier: Apache-2.0
"""The error of the curves that an autopilot fits to its own logs."""
