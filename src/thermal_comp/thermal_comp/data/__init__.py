# SPDX-License-Identifier: Apache-2.0
"""What is fitted: conditions of a measurement, runs as block means, quality of the data."""
