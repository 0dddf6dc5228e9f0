# SPDX-License-Identifier: Apache-2.0
"""Bags below the root of a server, and nothing above it."""

from __future__ import annotations

from pathlib import Path

import pytest
from imu_workbench.web.bag_root import BagRoot, RootError


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in ('root/a', 'root/deep/b', 'outside/c'):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / 'metadata.yaml').write_text('')
    (tmp_path / 'root' / 'single.mcap').write_bytes(b'')
    (tmp_path / 'root' / 'link').symlink_to(tmp_path / 'outside' / 'c')
    return tmp_path


def test_bags_below_the_root_are_listed_and_links_are_not_followed(tree):
    root = BagRoot.of([], tree / 'root')
    assert [root.name_of(bag) for bag in root.bags()] == ['a', 'deep/b', 'single.mcap']


@pytest.mark.parametrize('path', ['../outside/c', 'link', '/etc', 'deep/../../outside'])
def test_nothing_outside_is_opened(tree, path):
    with pytest.raises(RootError, match='--root'):
        BagRoot.of([], tree / 'root').locate(path)


def test_a_bag_whose_file_lies_outside_is_not_opened(tree):
    (tree / 'root' / 'a' / 'x.mcap').symlink_to(tree / 'outside' / 'c' / 'metadata.yaml')
    with pytest.raises(RootError, match='outside'):
        BagRoot.of([], tree / 'root').locate('a')


@pytest.mark.parametrize('text', ['a\0b', 'x' * 5000, '~nobody_at_all/x'])
def test_what_is_no_path_at_all_is_said(tree, text):
    with pytest.raises(RootError):
        BagRoot.of([], tree / 'root').locate(text)


def test_what_is_missing_is_said(tree):
    with pytest.raises(RootError, match=r'nowhere: no such file'):
        BagRoot.of([], tree / 'root').locate('nowhere')


def test_the_root_is_the_folder_above_all_bags(tree):
    bags = [tree / 'root' / 'a', tree / 'root' / 'deep' / 'b']
    assert BagRoot.of(bags).folder == tree / 'root'
    with pytest.raises(RootError, match='no such folder'):
        BagRoot.of([], tree / 'missing')
