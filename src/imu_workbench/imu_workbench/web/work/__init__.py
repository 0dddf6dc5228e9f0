# SPDX-License-Identifier: Apache-2.0
"""What a server works on: cases, versions, fits in a queue, jobs in processes of their own."""
