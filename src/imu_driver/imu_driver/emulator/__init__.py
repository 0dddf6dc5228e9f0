# SPDX-License-Identifier: Apache-2.0
"""An emulated board: the wire protocol's other end, with the faults of a line."""
