# SPDX-License-Identifier: Apache-2.0
"""Driver for LSM9DS1-class IMU boards on a serial line, with emulator and simulated device."""
