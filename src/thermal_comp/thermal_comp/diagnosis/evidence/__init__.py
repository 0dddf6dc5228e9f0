# SPDX-License-Identifier: Apache-2.0
"""Sets of effects as hypotheses about a residual: priors, evidence, probabilities."""
