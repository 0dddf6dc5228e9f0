# SPDX-License-Identifier: Apache-2.0
"""The columnar IMU recording, bag input and output, message conversion and the recorder node."""
