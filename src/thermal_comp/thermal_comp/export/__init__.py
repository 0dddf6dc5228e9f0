# SPDX-License-Identifier: Apache-2.0
"""A thermal model in the forms that other software reads."""
