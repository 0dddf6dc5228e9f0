# SPDX-License-Identifier: Apache-2.0
"""Plans of the thermal cycle that best tells two rival effects apart."""
