# SPDX-License-Identifier: Apache-2.0
"""One run of a profile: the decisions, the journal, the link to the chamber, the ROS messages."""
