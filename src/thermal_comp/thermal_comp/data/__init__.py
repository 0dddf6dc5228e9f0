# SPDX-License-Identifier: Apache-2.0
"""The data that are fitted: conditions of a measurement, runs as block means, data quality."""
