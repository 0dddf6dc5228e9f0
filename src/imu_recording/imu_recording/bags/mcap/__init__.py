# SPDX-License-Identifier: Apache-2.0
"""Mcap files: read whole or cut, written piece by piece, repaired."""
