# SPDX-License-Identifier: Apache-2.0
"""The journal survives a power cut at any byte, and knows where the run was."""

import errno
import json
import os

import pytest
from chamber_profile.profile.file import load_profile
from chamber_profile.run.journal import Journal, JournalError, load_run, read_journal
from chamber_profile.run.values import DONE, IDLE, RUN, Note, Progress

PROFILE = load_profile('short_20min')


@pytest.fixture
def directory(tmp_path):
    journal = Journal(tmp_path)
    journal.begin(PROFILE, 1, chamber='simulated')
    for step in range(4):
        journal.write(Note('step', Progress(RUN, step, 'move', 20.0 + step), {'x': 1}), 2 + step)
    journal.close()
    return tmp_path


def test_what_was_written_is_read_back(directory) -> None:
    entries = read_journal(directory)
    assert [entry['event'] for entry in entries] == ['open', *4 * ['step']]
    assert entries[0]['sha256'] == PROFILE.sha256
    run = load_run(directory)
    assert run.profile == PROFILE
    assert run.progress == Progress(IDLE, 3, 'move', 23.0)


def test_cut_anywhere_it_still_says_where_the_run_was(directory, monkeypatch) -> None:
    monkeypatch.setattr(os, 'fsync', lambda _: None)  # hundreds of journals, no power cut
    path = directory / 'journal.jsonl'
    data = path.read_bytes()
    first = data.index(b'\n') + 1
    for size in range(first, len(data), 7):
        path.write_bytes(data[:size])
        whole = data[:size].count(b'\n') - 1
        assert load_run(directory).progress.step == max(whole - 1, 0)
        journal = Journal(directory)
        journal.write(Note('start', Progress(RUN, 9)), 99)
        journal.close()
        assert load_run(directory).progress.step == 9
        assert len(read_journal(directory)) == whole + 2


def test_each_entry_is_synced_before_write_returns(tmp_path, monkeypatch) -> None:
    synced = []
    real = os.fsync
    monkeypatch.setattr(os, 'fsync', lambda fd: (synced.append(os.fstat(fd).st_size), real(fd)))
    journal = Journal(tmp_path)
    journal.begin(PROFILE, 1)
    for step in range(3):
        journal.write(Note('step', Progress(RUN, step)), step)
        assert synced[-1] == (tmp_path / 'journal.jsonl').stat().st_size


def test_a_disk_that_fills_in_the_middle_of_a_line_leaves_whole_ones(
    directory, monkeypatch
) -> None:
    journal = Journal(directory)
    real = os.write

    def half(descriptor: int, data: bytes) -> int:
        monkeypatch.setattr(os, 'write', full)
        return real(descriptor, data[: len(data) // 2])

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(os, 'write', half)
    with pytest.raises(OSError, match='No space left'):
        journal.write(Note('step', Progress(RUN, 7)), 60)
    monkeypatch.setattr(os, 'write', real)
    journal.write(Note('step', Progress(RUN, 8)), 61)
    journal.close()
    assert load_run(directory).progress.step == 8


def test_a_finished_run_is_refused_with_the_way_out(directory) -> None:
    journal = Journal(directory)
    journal.write(Note('done', Progress(DONE, 8)), 50)
    journal.close()
    with pytest.raises(JournalError, match=r'finished \(DONE\); leave run_directory empty'):
        load_run(directory)


def test_a_changed_profile_or_a_damaged_journal_is_refused(directory) -> None:
    (directory / 'profile.yaml').write_text(PROFILE.text.replace('2.5', '1.5'))
    with pytest.raises(JournalError, match='changed since the run began'):
        load_run(directory)
    path = directory / 'journal.jsonl'
    lines = path.read_text().splitlines()
    path.write_text('\n'.join([lines[0], '{"ev', *lines[2:]]) + '\n')
    with pytest.raises(JournalError, match='line 2 is damaged'):
        load_run(directory)
    with pytest.raises(JournalError, match='no journal'):
        load_run(directory / 'elsewhere')


def test_entries_are_plain_json_lines(directory) -> None:
    for line in (directory / 'journal.jsonl').read_text().splitlines():
        assert json.loads(line)['stamp'] > 0
