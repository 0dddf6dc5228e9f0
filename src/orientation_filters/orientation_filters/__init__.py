# SPDX-License-Identifier: Apache-2.0
"""Orientation of an IMU: complementary filter and 12-state indirect Kalman AHRS."""
