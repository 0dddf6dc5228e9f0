# SPDX-License-Identifier: Apache-2.0
"""Plan the thermal cycle that best tells two rival effects apart."""
