# SPDX-License-Identifier: Apache-2.0
"""What the devices of a fleet share, and which of them do not belong: distributions and tests."""
