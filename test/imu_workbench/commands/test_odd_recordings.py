# SPDX-License-Identifier: Apache-2.0
"""Whatever a recording is like, every verb answers or says in one line why it cannot.

Every odd recording meets one of the verbs and every verb some of the recordings. Each with each,
the whole catalogue and many random recordings: `make test-odd`, more than half an hour.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from imu_workbench.__main__ import main
from imu_workbench.answer import CHECK_FAILED
from imu_workbench.fleet.engine import Cluster
from thermal_comp.effects import EFFECTS
from thermal_comp.experiment.design import design_experiment

from imu_recording import ImuRecording, write_bag

ALL = os.environ.get('ODD_RECORDINGS') == 'all'
FEW = ('bias_temperature', 'thermal_lag', 'misalignment_temperature', 'bias_step', 'mains_alias')
"""Effects that stand for the whole catalogue: a lag, axes that share, one per run, a line."""

Change = Callable[[ImuRecording], ImuRecording]


def part(start: float, length: float) -> Change:
    """Return what cuts a recording [s]."""
    return lambda r: r.rows((r.time >= start) & (r.time < start + length))


def bursts(on: float, every: float) -> Change:
    """Return what keeps `on` of `every` seconds."""
    return lambda r: r.rows(r.time % every < on)


def gap(start: float, length: float) -> Change:
    """Return what loses a stretch [s]."""
    return lambda r: r.rows((r.time < start) | (r.time >= start + length))


def thinned(step: int) -> Change:
    """Return what keeps one row of `step`."""
    return lambda r: r.rows(slice(None, None, step))


def clock_step(start: float, by: float) -> Change:
    """Return what adds `by` seconds to all later stamps; rows of a step back are lost."""

    def change(r: ImuRecording) -> ImuRecording:
        late = r.time >= start
        stamp = r.stamp + np.where(late, round(by * 1e9), 0)
        before = stamp[~late].max(initial=stamp[0] - 1)
        return replace(r, stamp=stamp).rows(~late | (stamp > before))

    return change


def lost(name: str, start: float = 0.0, length: float = np.inf) -> Change:
    """Return what makes a track NaN for a stretch [s]."""

    def change(r: ImuRecording) -> ImuRecording:
        if getattr(r, name) is None:
            return r
        values = getattr(r, name).copy()
        values[(r.time >= start) & (r.time < start + length)] = np.nan
        return replace(r, **{name: values})

    return change


def without(*names: str) -> Change:
    """Return what leaves out tracks that need not be logged."""
    return lambda r: replace(r, **dict.fromkeys(names))


def constant(name: str, axis: int) -> Change:
    """Return what makes one axis of a sensor stand still."""

    def change(r: ImuRecording) -> ImuRecording:
        values = getattr(r, name).copy()
        values[:, axis] = values[:1, axis]
        return replace(r, **{name: values})

    return change


def coarse(name: str, step: float) -> Change:
    """Return what rounds a track."""

    def change(r: ImuRecording) -> ImuRecording:
        values = getattr(r, name)
        return r if values is None else replace(r, **{name: np.round(values / step) * step})

    return change


def spikes(name: str, size: float) -> Change:
    """Return what adds a spike every hundred rows."""

    def change(r: ImuRecording) -> ImuRecording:
        values = getattr(r, name).copy()
        values[50::100] += size
        return replace(r, **{name: values})

    return change


def renumbered(first: int) -> Change:
    """Return what counts the thermal cycles from another number."""

    def change(r: ImuRecording) -> ImuRecording:
        known = r.cycle is not None
        return replace(r, cycle=np.where(r.cycle > 0, r.cycle - 1 + first, 0)) if known else r

    return change


def anonymous(r: ImuRecording) -> ImuRecording:
    """Forget what the recording was called."""
    return replace(r, device='', run='', up_axis='', profile='')


def also(**changes: object) -> Change:
    """Return what sets fields."""
    return lambda r: replace(r, **changes)


CYCLES = ('phase', 'cycle', 'setpoint')
ODD: dict[str, list[tuple[Change, ...]]] = {
    'two samples': [(part(0.0, 2.0),)],
    'half a minute': [(part(560.0, 30.0),)],
    'two minutes': [(part(600.0, 130.0),)],
    'eight minutes, twice': [(part(600.0, 500.0),), (part(900.0, 500.0),)],
    'eleven minutes': [(part(400.0, 660.0),)],
    'long and short': [(), (part(600.0, 130.0),)],
    'bursts': [(bursts(15.0, 90.0),)],
    'bursts between blocks': [(bursts(3.0, 33.0),)],
    'a long gap': [(gap(700.0, 600.0),)],
    'an hour between two parts': [(clock_step(900.0, 3600.0),)],
    'a clock that steps by a day': [(clock_step(900.0, 86400.0),)],
    'a clock that steps back': [(clock_step(900.0, -300.0),)],
    'one row in a minute': [(thinned(60),)],
    'one row in ten minutes': [(thinned(600),)],
    'two rates': [(thinned(3),), ()],
    'an aborted run': [(), (part(0.0, 1300.0),)],
    'without cycles': [(without(*CYCLES),)],
    'with and without cycles': [(), (without(*CYCLES),)],
    'cycles counted differently': [(), (renumbered(7),)],
    'temperature alone': [(without(*CYCLES, 'chamber_temperature', 'device_temperature'),)],
    'no magnetometer': [(lost('magnetic_field'),)],
    'no accelerometer': [(lost('linear_acceleration'),)],
    'gyroscope alone': [(lost('linear_acceleration'), lost('magnetic_field'))],
    'a magnetometer for a while': [(lost('magnetic_field', 300.0),)],
    'a magnetometer that comes late': [(lost('magnetic_field', 0.0, 1000.0),)],
    'one axis constant': [(constant('angular_velocity', 1),)],
    'all axes constant': [tuple(constant('linear_acceleration', a) for a in range(3))],
    'temperature lost for a while': [(lost('temperature', 600.0, 500.0),)],
    'temperature that comes late': [(lost('temperature', 0.0, 900.0),)],
    'air temperature lost': [(lost('chamber_temperature', 600.0, 500.0),)],
    'coarse temperature': [(coarse('temperature', 10.0),)],
    'coarse gyroscope': [(coarse('angular_velocity', 1e-3),)],
    'spikes': [(spikes('linear_acceleration', 1e4),)],
    'no names': [(anonymous,), (anonymous, part(0.0, 1500.0))],
    'the same twice': [(), ()],
    'two devices': [(), (also(device='dut2'),)],
}


VERBS: dict[str, tuple[str, ...]] = {
    'compare': ('compare',),
    'diagnose': ('diagnose',),
    'auto': ('auto', '-o', 'auto.yaml'),
    'add': ('add', 'thermal_lag', '-o', 'added.yaml'),
    'report': ('report', '--no-attitude', '-o', 'report.html'),
    'fit --pooled': ('fit', '--pooled', '-o', 'pooled.yaml'),
    'compare with a model': ('compare', '--model', 'model.yaml'),
    'diagnose a model': ('diagnose', '--model', 'model.yaml'),
    'add to a model': ('add', 'bias_step', '--model', 'model.yaml', '-o', 'more.yaml'),
    'apply': ('apply', '--model', 'model.yaml', '-o', 'applied'),
    'orient': ('orient', '--model', 'model.yaml', '--preset', 'robust', '--six-axis'),
    'report with a model': ('report', '--model', 'model.yaml', '-o', 'other.html'),
    'compare --across': ('compare', '--across'),
    'export to C': ('export', 'model.yaml', '--to', 'c99', '-o', 'c_code'),
    'export to PX4': ('export', 'model.yaml', '--to', 'px4', '-o', 'board.params'),
    'second-opinion': ('second-opinion', '--autopilot', 'ardupilot'),
    'still': ('still', '--bags', 'rests', '-o', 'still.yaml'),
    'fleet': ('fleet', '-o', 'fleet_out', '--workers', '1'),
    'next-experiment': (
        *('next-experiment', 'thermal_lag', 'bias_step', '--hours', '9'),
        *('--model', 'model.yaml', '-o', 'next.yaml'),
    ),
}
"""Arguments of what takes recordings or their model; files stand in the folder of the test."""
FOLDERS = ('applied', 'c_code', 'rests', 'fleet_out')
"""Folders among the arguments; every other file has a dot in its name."""
BEFORE_BAGS = {'add': 1, 'export': 1}
"""How many arguments of a verb come before the bags."""
WITHOUT_BAGS = ('next-experiment',)


@pytest.fixture(scope='module')
def whole(run: Callable[..., ImuRecording]) -> list[ImuRecording]:
    """Return runs of one device in two orientations."""
    return [run('dut1', up, seed=seed, cycles=2) for seed, up in enumerate('xz')]


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search some effects instead of all, a plan not for long, a fleet in this process."""
    if not ALL:
        chosen = {name: EFFECTS[name] for name in FEW}
        monkeypatch.setattr('thermal_comp.effects.user_effects.EFFECTS', chosen)
    quick = partial(design_experiment, evaluations=2)
    monkeypatch.setattr('imu_workbench.commands.next_experiment.design_experiment', quick)
    here = partial(Cluster, processes=False)
    monkeypatch.setattr('imu_workbench.fleet.engine.Cluster', here)


def answered(argv: Sequence[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> bool:
    """Tell whether the verb answers; else it has to say why not in one line.

    A model that is worse than a line is an answer that is not saved.
    """
    here = [str(folder / word) if '.' in word or word in FOLDERS else word for word in argv]
    capsys.readouterr()
    code = main([*here, '--json', str(folder / 'answer.json')])
    said = capsys.readouterr()
    assert code in (0, 2, CHECK_FAILED), (argv, said.err)
    assert said.err.count('\n') == (code == 2), (argv, said.err)
    assert said.out or code == 2, argv
    return code == 0


def check(
    recordings: Sequence[ImuRecording],
    verbs: Sequence[str],
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Write the recordings as bags, fit them, and let the verbs have them."""
    bags = []
    for number, recording in enumerate(recordings):
        bags.append(str(folder / f'bag{number}'))
        write_bag(recording, bags[-1])
    fitted = answered(['fit', *bags, '-o', 'model.yaml'], folder, capsys)
    for verb in verbs:
        name, *arguments = VERBS[verb]
        if fitted or 'model.yaml' not in arguments:
            place = BEFORE_BAGS.get(name, 0)
            taken = [] if name in WITHOUT_BAGS else bags
            answered([name, *arguments[:place], *taken, *arguments[place:]], folder, capsys)


def changed(recording: ImuRecording, changes: Sequence[Change]) -> ImuRecording:
    """Return the recording after all changes."""
    for change in changes:
        recording = change(recording)
    return recording


@pytest.mark.parametrize(
    'name',
    [
        name if ALL or n % 4 == 0 else pytest.param(name, marks=pytest.mark.long)
        for n, name in enumerate(ODD)
    ],
)
def test_every_verb_answers_odd_recordings_or_says_why_not(
    name: str, whole: list[ImuRecording], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recordings = [changed(*pair) for pair in zip(whole, ODD[name], strict=False)]
    verbs = list(VERBS) if ALL else [list(VERBS)[[*ODD].index(name) % len(VERBS)]]
    check(recordings, verbs, tmp_path, capsys)


seconds = st.floats(0.0, 2400.0)
tracks = st.sampled_from(('angular_velocity', 'linear_acceleration', 'magnetic_field'))
others = st.sampled_from(('temperature', 'chamber_temperature', 'setpoint'))
odd_changes = st.one_of(
    st.builds(part, st.floats(0.0, 1800.0), st.floats(20.0, 2400.0)),
    st.builds(bursts, st.floats(2.0, 200.0), st.floats(10.0, 600.0)),
    st.builds(gap, seconds, st.floats(1.0, 2000.0)),
    st.builds(thinned, st.integers(2, 200)),
    st.builds(clock_step, seconds, st.floats(-1000.0, 1e6)),
    st.builds(lost, tracks | others, seconds, seconds),
    st.builds(constant, tracks, st.integers(0, 2)),
    st.builds(coarse, tracks | others, st.floats(1e-6, 20.0)),
    st.builds(spikes, tracks, st.floats(1e-3, 1e6)),
    st.builds(renumbered, st.integers(0, 40)),
    st.just(without(*CYCLES)),
    st.just(anonymous),
)


@settings(
    max_examples=300 if ALL else 3,
    deadline=None,
    derandomize=not ALL,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    database=None,
    phases=[Phase.generate],
    report_multiple_bugs=False,
)
@given(
    changes=st.lists(st.lists(odd_changes, max_size=3), min_size=1, max_size=2),
    verb=st.sampled_from(sorted(VERBS)),
)
def test_every_verb_answers_any_recording_or_says_why_not(
    changes: list[list[Change]],
    verb: str,
    whole: list[ImuRecording],
    capsys: pytest.CaptureFixture[str],
) -> None:
    recordings = [changed(*pair) for pair in zip(whole, changes, strict=False)]
    with TemporaryDirectory() as folder:
        if all(map(len, recordings)):
            check(recordings, [verb], Path(folder), capsys)
