# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of the simulated device, each a law on its own nodes, fields and processes."""
