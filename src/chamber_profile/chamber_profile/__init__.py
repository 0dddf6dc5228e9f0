# SPDX-License-Identifier: Apache-2.0
"""Runs a climatic chamber through a thermal test plan, safely, and records it."""
