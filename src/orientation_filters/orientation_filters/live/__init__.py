# SPDX-License-Identifier: Apache-2.0
"""A filter fed with samples as they arrive, its state in compiled memory; without ROS."""
