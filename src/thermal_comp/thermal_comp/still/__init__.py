# SPDX-License-Identifier: Apache-2.0
"""Temperature curves without a chamber: the stretches at rest of many logs of one device."""
