# SPDX-License-Identifier: Apache-2.0
"""Reading and writing bags: rosbag2 mcap and sqlite3, whole or cut, and ROS 1."""
