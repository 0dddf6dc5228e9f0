# SPDX-License-Identifier: Apache-2.0
"""The workbench: a local web page over the same functions as the commands."""
