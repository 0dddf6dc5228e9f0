# SPDX-License-Identifier: Apache-2.0
"""Linear least squares of effects over runs: design, whitening, normal equations, solution."""
