# SPDX-License-Identifier: Apache-2.0
"""Claims of the paper beside what the recordings of a report say about them."""
