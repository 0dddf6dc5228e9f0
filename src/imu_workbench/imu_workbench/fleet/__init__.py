# SPDX-License-Identifier: Apache-2.0
"""Many devices: an engine over their bags, what they share, which are odd, how short will do."""
