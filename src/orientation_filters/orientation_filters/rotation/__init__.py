# SPDX-License-Identifier: Apache-2.0
"""Rotations: quaternions and matrices, as columns and as scalars."""
