# SPDX-License-Identifier: Apache-2.0
"""A whole run over every protocol with every fault: to the safe state, or on after recovery."""

from pathlib import Path

import pytest
from chamber_profile.chambers.catalogue import CHAMBERS
from chamber_profile.chambers.chamber import ChamberError
from chamber_profile.emulators.chamber import SERVERS
from chamber_profile.emulators.faults import FaultPlan, damaged, parse_fault
from chamber_profile.emulators.plant import EmulatedPlant
from chamber_profile.profile.file import parse_profile
from chamber_profile.run.chamber_link import ChamberLink
from chamber_profile.run.conductor import Clocks, Conductor, ExternalReadings
from chamber_profile.run.journal import read_journal
from chamber_profile.run.sequencer import Sequencer
from chamber_profile.run.values import ABORTED, DONE

TINY = parse_profile("""\
schema: 1
name: tiny
limits: {air_min_c: 10, air_max_c: 30, rate_max_c_per_min: 3}
stabilise: {source: air, band_c: 0.6, timeout_s: 600}
steps:
  - {id: precondition, kind: precondition, target_c: 22, rate_c_per_min: 3, dwell_s: 60}
  - {id: cool, kind: ramp, target_c: 15, rate_c_per_min: 3}
  - {id: cold, kind: dwell, dwell_s: 120}
  - {id: return, kind: ramp, target_c: 22, rate_c_per_min: 3}
  - {id: final, kind: final, target_c: 22, rate_c_per_min: 3, dwell_s: 60}
on_abort: {target_c: 22, rate_c_per_min: 3, timeout_s: 300}
""")
TIMEOUT_S = 3.0


class MemoryLine:
    """A line to an emulator without a wire; what is not answered costs its time-out."""

    def __init__(self, protocol: str, *faults: str) -> None:
        self.now = 0.0
        self.body = EmulatedPlant(seed=3)
        self.plan = FaultPlan([parse_fault(text) for text in faults], self.body)
        self.server = SERVERS[protocol](self.body, 0, True)
        self.pause_s = 0.0

    def open(self) -> None:
        if 'disconnect' in self.plan.active_at(self.now):
            raise ChamberError('connection refused')

    def close(self) -> None:
        pass

    def ask(self, request: bytes, length) -> bytes:
        self.body.advance_to(self.now)
        active = self.plan.active_at(self.now)
        self.open()
        answer = b''.join(damaged(part, active) for part in self.server.feed(request))
        size = length(answer)
        if not size or len(answer) < size:
            self.now += TIMEOUT_S
            raise ChamberError('no answer')
        return answer[:size]

    def ask_text(self, request: bytes) -> bytes:
        return self.ask(request, len)


class Trial:
    """A run of the tiny profile over a protocol with faults, on one clock."""

    def __init__(self, folder: Path, protocol: str, *faults: str) -> None:
        self.line = MemoryLine(protocol, *faults)
        chamber = CHAMBERS[protocol].make(self.line, {'tcp': 1})

        def clock() -> float:
            return self.line.now

        link = ChamberLink(chamber, clock)
        self.folder = folder / 'run'
        self.sequencer = Sequencer(TINY)
        self.conductor = Conductor(
            self.sequencer, link, self.folder,
            Clocks(clock, clock, lambda: int(clock() * 1e9)), ExternalReadings,
        )  # fmt: skip
        self.sequencer.command('start')

    def run(self) -> list[dict]:
        while not self.conductor.over:
            assert self.line.now < 20_000, self.sequencer.progress
            self.line.now += 1.0
            self.conductor.step()
        self.conductor.close()
        return read_journal(self.folder)


@pytest.mark.parametrize('protocol', sorted(CHAMBERS))
def test_a_run_without_faults_is_done(protocol: str, tmp_path) -> None:
    trial = Trial(tmp_path, protocol)
    assert trial.run()[-1]['mode'] == DONE
    assert not trial.line.body.chamber.running


@pytest.mark.parametrize('protocol', sorted(CHAMBERS))
@pytest.mark.parametrize('fault', ['silence', 'garbage', 'half_line', 'bad_crc', 'refusals'])
def test_a_line_that_stays_broken_ends_the_run_in_the_safe_state(
    protocol: str, fault: str, tmp_path
) -> None:
    trial = Trial(tmp_path, protocol, f'{fault}@250')
    entries = trial.run()
    modes = [entry.get('mode') for entry in entries]
    hold = next(e for e in entries if e['event'] == 'hold')
    safe = next(e for e in entries if e.get('mode') == 'SAFE')
    assert modes[-1] == ABORTED
    assert 250e9 <= hold['stamp'] < safe['stamp'] <= hold['stamp'] + 16e9
    assert 'did not confirm' in entries[-1]['reason']


@pytest.mark.parametrize('protocol', sorted(CHAMBERS))
@pytest.mark.parametrize(
    'fault', ['silence', 'garbage', 'half_line', 'bad_crc', 'refusals', 'disconnect']
)
def test_a_line_that_heals_in_time_is_a_pause_only(protocol: str, fault: str, tmp_path) -> None:
    trial = Trial(tmp_path, protocol, f'{fault}@250+2')
    entries = trial.run()
    assert entries[-1]['mode'] == DONE
    events = [entry['event'] for entry in entries]
    assert 'safe' not in events
    if fault != 'refusals':  # two seconds may pass without an order
        assert {'hold', 'recovered'} <= set(events)


@pytest.mark.parametrize('protocol', sorted(CHAMBERS))
@pytest.mark.parametrize(
    ('fault', 'words'),
    [
        ('alarms@250', ('alarm', 'stopped at its panel')),
        ('operator_stop@250', ('stopped at its panel',)),
        ('stuck_compressor@100', ('not within 0.6 K of 15 °C',)),
    ],
)
def test_a_fault_of_the_chamber_ends_the_run_in_the_safe_state(
    protocol: str, fault: str, words: tuple[str, ...], tmp_path
) -> None:
    trial = Trial(tmp_path, protocol, fault)
    entries = trial.run()
    assert 'SAFE' in [entry.get('mode') for entry in entries]
    assert entries[-1]['mode'] == ABORTED
    assert any(word in entries[-1]['reason'] for word in words)
    assert not trial.line.body.chamber.running
