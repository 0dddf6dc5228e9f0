# SPDX-License-Identifier: Apache-2.0
"""A case on disk: versions, recordings, found answers; a damaged one is named."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from imu_workbench.case import (
    Case,
    CaseError,
    CaseRecording,
    RequestedFit,
    case_of_device,
    cases_in,
    found_in,
    load_case,
    lock_cases,
    saved,
    with_found,
    with_version,
)

ERRORS = {'gyroscope': {'measured': 3.0, 'error': 2.0, 'floor': 1.0}}


def example(folder: Path) -> Case:
    """A case with v1, v2 after it, and v3 that branches off v1."""
    case = case_of_device(folder, 'dut2')
    recording = CaseRecording('/bags/a', 'a', 'abc', 10)
    case = saved(replace(case, recordings=(recording,), settings={'effects': ['my.py']}))
    case = with_version(case, None, 'line per axis', 'one', ERRORS, ('a',))
    case = with_version(case, 'v1', '+ thermal lag', 'two', ERRORS, ('a',))
    return with_version(case, 'v1', '+ hysteresis', 'three', ERRORS, ('a',))


def test_what_was_saved_is_there_after_the_process_is_gone(tmp_path):
    case = example(tmp_path)
    case = saved(replace(case, requested=(RequestedFit('v2', 'icing', ('gyroscope',)),)))
    again = load_case(case.folder)
    assert again == case
    assert [again.model_text(name) for name in ('v1', 'v2', 'v3')] == ['one', 'two', 'three']
    assert cases_in(tmp_path) == [case.folder]
    assert case_of_device(tmp_path, 'dut2') == case


def test_versions_are_a_tree_of_which_nothing_is_deleted(tmp_path):
    case = example(tmp_path)
    assert [(v.name, depth) for v, depth in case.tree()] == [('v1', 0), ('v2', 1), ('v3', 1)]
    assert [v.name for v in case.path_to('v3')] == ['v1', 'v3']
    case = with_version(case, 'v2', '+ icing', 'four', ERRORS)
    assert [(v.name, depth) for v, depth in case.tree()] == [
        ('v1', 0), ('v2', 1), ('v4', 2), ('v3', 1),
    ]  # fmt: skip
    assert case.current == 'v4'


def test_what_was_found_belongs_to_the_recordings_it_was_found_in(tmp_path):
    case = with_found(example(tmp_path), 'v2', {'verdict': 'complete'})
    assert found_in(case, 'v2') == {'verdict': 'complete'}
    assert found_in(case, 'v1') is None
    more = replace(case, recordings=(*case.recordings, CaseRecording('/bags/b', 'b', 'def')))
    assert found_in(more, 'v2') is None
    (case.folder / 'found' / 'v2.json').write_text('{"recor', 'utf-8')
    assert found_in(case, 'v2') is None


def test_a_crash_while_writing_leaves_the_case_as_it_was(tmp_path, monkeypatch):
    case = example(tmp_path)

    def crash(*_: object) -> None:
        raise OSError('the disk is full')

    monkeypatch.setattr(Path, 'replace', crash)
    with pytest.raises(OSError, match='full'):
        with_version(case, 'v3', '+ icing', 'four', ERRORS)
    assert load_case(case.folder) == case


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('nonsense: [', 'not a YAML file'),
        ('schema: 7', 'schema is 7, expected 1'),
        ('schema: 1\ndevice: dut2', 'restore the file'),
    ],
)
def test_a_damaged_case_is_refused_in_a_line(tmp_path, text, message):
    (tmp_path / 'case.yaml').write_text(text, 'utf-8')
    with pytest.raises(CaseError, match=message) as refused:
        load_case(tmp_path)
    assert '\n' not in str(refused.value)


def test_a_version_without_its_parent_or_its_file_is_named(tmp_path):
    case = example(tmp_path)
    saved(replace(case, versions=case.versions[1:]))
    with pytest.raises(CaseError, match='v2 follows v1'):
        load_case(case.folder)
    case.model_file('v2').unlink()
    with pytest.raises(CaseError, match=r'v2\.yaml'):
        case.model_text('v2')


def test_cases_belong_to_one_server_until_it_dies(tmp_path):
    script = (
        'import sys, time; from pathlib import Path; from imu_workbench.case import lock_cases\n'
        'held = lock_cases(Path(sys.argv[1])); print("held", flush=True); sys.stdin.read()'
    )
    holder = subprocess.Popen(
        [sys.executable, '-c', script, str(tmp_path)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert holder.stdout
    assert holder.stdout.readline() == 'held\n'
    with pytest.raises(CaseError, match='--case DIR'):
        lock_cases(tmp_path)
    holder.kill()
    holder.wait()
    lock_cases(tmp_path).close()


def test_devices_whose_names_are_written_alike_have_cases_of_their_own(tmp_path):
    one, other = case_of_device(tmp_path, 'a/b'), case_of_device(tmp_path, 'a:b')
    assert one.folder != other.folder
    assert [load_case(p).device for p in cases_in(tmp_path)] == ['a/b', 'a:b']
