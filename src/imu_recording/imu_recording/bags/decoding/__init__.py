# SPDX-License-Identifier: Apache-2.0
"""Serialised messages to columns, by kernels where the layout is known."""
