# SPDX-License-Identifier: Apache-2.0
"""The wire protocol of the boards (doc/wire_protocol.md): frames and their two encodings."""
