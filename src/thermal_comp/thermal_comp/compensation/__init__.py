# SPDX-License-Identifier: Apache-2.0
"""Subtract the modelled error: from whole recordings and sample by sample."""
