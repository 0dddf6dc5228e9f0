# SPDX-License-Identifier: Apache-2.0
"""Which physical effects a residual holds, and what can be said where none explains it."""
