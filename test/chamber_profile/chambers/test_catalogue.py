# SPDX-License-Identifier: Apache-2.0
"""Addresses of chambers: a wrong one is refused with what would be right."""

import pytest
from chamber_profile.chambers.catalogue import open_chamber
from chamber_profile.chambers.chamber import ChamberError
from chamber_profile.chambers.protocol import ChamberAddressError


@pytest.mark.parametrize(
    ('address', 'words'),
    [
        ('coffee+tcp://localhost:1', 'protocols: simulated, ascii2, espec, simserv, watlow_f4'),
        ('espec', 'write e.g.'),
        ('espec+tcp://localhost', 'tcp://HOST:PORT'),
        ('espec+tcp://localhost:99999', '99999'),
        ('espec+serial://ttyUSB0', 'serial:///dev'),
        ('espec+tcp://h:1?baud=3', "option 'baud'; known: baudrate, timeout, address"),
        ('espec+tcp://h:1?address=x', 'no whole number'),
        ('simulated?seed=x', 'no whole number'),
    ],
)
def test_an_address_that_names_no_chamber_says_what_would(address: str, words: str) -> None:
    with pytest.raises(ChamberAddressError) as caught:
        open_chamber(address)
    assert words in str(caught.value)


def test_address_options_reach_the_driver() -> None:
    chamber = open_chamber('espec+serial:///dev/ttyUSB7?address=3&baudrate=9600')
    assert chamber._prefix == '3,'
    assert chamber._line.baudrate == 9600
    assert chamber._line.port == '/dev/ttyUSB7'
    with pytest.raises(ChamberError, match='ttyUSB7'):
        chamber.connect()


def test_another_package_adds_a_protocol_by_its_entry_point(monkeypatch) -> None:
    made = []

    class Point:
        name = 'thermotron'

        def load(self):
            return lambda line, options: made.append((line.port, line.baudrate, dict(options)))

    monkeypatch.setattr('chamber_profile.chambers.catalogue.entry_points', lambda group: [Point()])
    open_chamber('thermotron+tcp://h:1?channel=2&baudrate=4800')
    assert made == [('socket://h:1', 4800, {'channel': 2, 'tcp': 1})]
    with pytest.raises(ChamberAddressError, match='thermotron'):
        open_chamber('coffee+tcp://h:1')
