# SPDX-License-Identifier: Apache-2.0
"""The chain from device to orientation in one process, and its launch files."""
