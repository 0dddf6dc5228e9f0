# SPDX-License-Identifier: Apache-2.0
"""The reference logger: a data logger of PT100s and thermocouples as temperature topics."""
