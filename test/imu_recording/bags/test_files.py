# SPDX-License-Identifier: Apache-2.0
"""A bag's files are found, in order, and its kind is told by their first bytes."""

from __future__ import annotations

from pathlib import Path

import pytest
from imu_recording.bags.files import locate_bag
from imu_recording.bags.mcap.reader import McapScan, read_summary
from imu_recording.bags.metadata import inspect_file
from imu_recording.bags.scan import topics_of_file
from recording_samples import START, make_bag, standard_messages

from imu_recording import BagError


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_what_a_bag_is_made_of(tmp_path: Path, storage: str) -> None:
    path = make_bag(
        tmp_path / 'b', standard_messages(4), storage=storage, custom={'device': 'dut7'}
    )
    bag = locate_bag(path)
    assert [file.storage for file in bag.files] == [storage]
    assert bag.custom == {'device': 'dut7'}
    assert locate_bag(path / 'metadata.yaml').files == bag.files
    topics = topics_of_file(bag.files[0])
    assert topics['/imu/mag'][0] == 'sensor_msgs/msg/MagneticField'


def test_files_are_in_natural_order(tmp_path: Path) -> None:
    for number in (10, 2, 0):
        made = make_bag(tmp_path / f'b{number}', standard_messages(1))
        (tmp_path / 'joined').mkdir(exist_ok=True)
        (made / f'b{number}.mcap').rename(tmp_path / 'joined' / f'part_{number}.mcap')
    names = [file.path.name for file in locate_bag(tmp_path / 'joined').files]
    assert names == ['part_0.mcap', 'part_2.mcap', 'part_10.mcap']


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='no such file or folder'):
        locate_bag(tmp_path / 'absent')
    with pytest.raises(BagError, match='no bag in this folder'):
        locate_bag(tmp_path)
    (tmp_path / 'a.mcap').write_bytes(b'something else')
    with pytest.raises(BagError, match='first bytes are wrong'):
        locate_bag(tmp_path / 'a.mcap')
    make_bag(tmp_path / 'runs' / 'b', standard_messages(1))
    with pytest.raises(BagError, match='a folder of bags; name one: b'):
        locate_bag(tmp_path / 'runs')


def test_the_summary_of_an_mcap_file_is_what_a_scan_finds(tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'b', standard_messages(7)) / 'b.mcap'
    scan = McapScan(select=lambda _: -1, deliver=lambda _: None)
    with path.open('rb') as stream:
        scan.run(stream, str(path))
    summary = read_summary(path)
    assert summary == {c.topic: (c.message_type, 7) for c in scan.channels.values()}
    file, types = inspect_file(path)
    assert file.counts == dict.fromkeys(types, 7)
    assert (file.first, file.last) == (START, START + 6 * 10_000_000)
    path.write_bytes(path.read_bytes()[:-20])
    assert read_summary(path) is None
    assert inspect_file(path)[0].counts == file.counts


def test_metadata_nested_without_end_is_done_without(tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'b', standard_messages(4))
    (path / 'metadata.yaml').write_text('a: ' + '[' * 100_000)
    bag = locate_bag(path)
    assert [file.storage for file in bag.files] == ['mcap']
    assert 'metadata.yaml cannot be read: the files were scanned without it' in bag.notes
