# SPDX-License-Identifier: Apache-2.0
"""The address a server listens at."""

from __future__ import annotations

import pytest
from imu_workbench.web.server import PortError, bind


def test_a_port_that_is_taken_is_said_with_a_way_out():
    with bind('127.0.0.1', 0) as listening:
        port = listening.getsockname()[1]
        with pytest.raises(PortError, match=rf'--port {port}: .*choose another with --port'):
            bind('127.0.0.1', port)


def test_an_address_of_another_machine_cannot_be_bound():
    with pytest.raises(PortError, match='give an address of this machine with --host'):
        bind('192.0.2.1', 0)
