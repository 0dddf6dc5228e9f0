# SPDX-License-Identifier: Apache-2.0
"""Measured against modelled: where a model fails, in numbers."""
