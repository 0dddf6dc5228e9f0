# SPDX-License-Identifier: Apache-2.0
"""Results as text, tables and pictures: units for people, comparison, diagnosis, growth."""
