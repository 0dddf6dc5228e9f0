# SPDX-License-Identifier: Apache-2.0
"""Attitude and heading reference system: 12-state indirect Kalman filter."""
