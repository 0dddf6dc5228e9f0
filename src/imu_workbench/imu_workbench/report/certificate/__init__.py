# SPDX-License-Identifier: Apache-2.0
"""The calibration certificate: coefficients of a device with their uncertainty budgets."""
