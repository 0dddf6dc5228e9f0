# SPDX-License-Identifier: Apache-2.0
"""The report: content (plain values), figures (plain Plotly specifications), one HTML page."""
