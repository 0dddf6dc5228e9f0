# SPDX-License-Identifier: Apache-2.0
"""The figures of a case: over time, against variables, noise, where it fails."""
