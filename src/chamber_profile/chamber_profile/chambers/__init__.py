# SPDX-License-Identifier: Apache-2.0
"""Climatic chambers: the interface, one module per family of protocols, the catalogue."""
