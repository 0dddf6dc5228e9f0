# SPDX-License-Identifier: Apache-2.0
"""Measurements of both robust filters: averages over short steps, and their variances."""
