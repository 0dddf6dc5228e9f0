# SPDX-License-Identifier: Apache-2.0
"""When the link to a chamber fails, is lost and recovers; an accelerated clock is refused."""

import pytest
from chamber_profile.chambers.chamber import ChamberError, ChamberReading
from chamber_profile.run.chamber_link import ChamberLink, ClockError
from chamber_profile.run.values import LINK_FAILING, LINK_LOST, LINK_OK


class UnreliableChamber:
    """A chamber whose link works or not, as told."""

    emulated, programs_limits, resolution_c = False, True, 0.1

    def __init__(self) -> None:
        self.works = True

    def connect(self) -> str:
        return self.read() and 'a real chamber'

    def read(self) -> ChamberReading:
        if not self.works:
            raise ChamberError('broken')
        return ChamberReading(20.0, 20.0, running=True)


def test_three_failures_within_fifteen_seconds_lose_the_link_and_it_comes_back() -> None:
    now, chamber = [0.0], UnreliableChamber()
    link = ChamberLink(chamber, lambda: now[0])
    assert link.read() is not None
    chamber.works = False
    seen = []
    for _ in range(20):
        now[0] += 1.0
        link.read()
        seen.append(link.status)
    assert seen[:10] == 10 * [LINK_FAILING]
    assert seen[10] == LINK_LOST  # tried at 1, 6 and 11 s
    chamber.works = True
    for _ in range(6):
        now[0] += 1.0
        link.read()
    assert link.status == LINK_OK


def test_failures_far_apart_do_not_lose_the_link() -> None:
    now, chamber = [0.0], UnreliableChamber()
    link = ChamberLink(chamber, lambda: now[0])
    for _ in range(10):
        chamber.works = False
        now[0] += 1.0
        link.read()
        assert link.status == LINK_FAILING
        chamber.works = True
        now[0] += 20.0
        link.read()
        assert link.status == LINK_OK


def test_an_accelerated_clock_is_refused_before_anything_is_ordered() -> None:
    link = ChamberLink(UnreliableChamber(), lambda: 0.0, time_scale=60.0)
    with pytest.raises(ClockError, match='emulated'):
        link.read()
