# SPDX-License-Identifier: Apache-2.0
"""The recorder: topics to bags, one for each run, on disk every second."""
