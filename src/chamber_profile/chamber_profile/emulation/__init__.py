# SPDX-License-Identifier: Apache-2.0
"""The chamber's end of each protocol, for tests and for trying without a chamber."""
