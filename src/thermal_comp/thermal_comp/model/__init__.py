# SPDX-License-Identifier: Apache-2.0
"""The thermal model as a value and as a YAML file."""
