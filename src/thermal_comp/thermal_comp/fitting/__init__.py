# SPDX-License-Identifier: Apache-2.0
"""Fit thermal models: shape parameters by search, coefficients by generalised least squares."""
