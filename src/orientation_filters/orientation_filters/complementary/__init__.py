# SPDX-License-Identifier: Apache-2.0
"""Complementary filter: gyroscope above the cut-off, accelerometer and magnetometer below."""
