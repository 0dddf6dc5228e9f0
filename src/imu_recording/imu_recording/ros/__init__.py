# SPDX-License-Identifier: Apache-2.0
"""What every node is built on: parameters, lifecycle, messages, diagnostics, the process."""
