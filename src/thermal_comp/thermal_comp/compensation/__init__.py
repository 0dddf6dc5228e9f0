# SPDX-License-Identifier: Apache-2.0
"""Subtraction of the modelled error, from whole recordings and sample by sample."""
