# SPDX-License-Identifier: Apache-2.0
"""Climatic chambers, one module per family of protocols."""
