# SPDX-License-Identifier: Apache-2.0
"""A connected board: its line, its session, its clock, its sensors' scales."""
