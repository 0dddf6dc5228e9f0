# SPDX-License-Identifier: Apache-2.0
"""Commands, report and web page that compare IMU thermal models with measurements."""
