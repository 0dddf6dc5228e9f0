# SPDX-License-Identifier: Apache-2.0
"""Noise of a sensor: white noise and Ornstein-Uhlenbeck processes, fitted to residuals."""
