# SPDX-License-Identifier: Apache-2.0
"""Live view of a running system: what a device publishes, and the page that shows it."""
