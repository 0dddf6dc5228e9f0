# SPDX-License-Identifier: Apache-2.0
"""Published tables of statistics: the paper's, and checks that find impossible numbers."""
