# SPDX-License-Identifier: Apache-2.0
"""Measurements from tables: CSV files and the mapping of their columns."""
