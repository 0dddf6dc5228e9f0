# SPDX-License-Identifier: Apache-2.0
"""Pages about one case: a device's recordings against the versions of its model."""
