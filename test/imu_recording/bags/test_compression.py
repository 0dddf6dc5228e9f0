# SPDX-License-Identifier: Apache-2.0
"""Chunks, messages and files are decompressed whole, and as far as they go where they are cut."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.bags.compression import (
    ZstdFile,
    compress_chunk,
    decompress_chunk,
    decompress_message,
)

DATA = np.random.default_rng(1).integers(0, 20, 300_000).astype(np.uint8).tobytes()


@pytest.mark.parametrize('compression', ['', 'zstd', 'lz4'])
def test_a_chunk_whole_and_cut(compression: str) -> None:
    packed = memoryview(compress_chunk(DATA, compression))
    assert bytes(decompress_chunk(packed, compression, len(DATA))) == DATA
    part = bytes(decompress_chunk(packed[: len(packed) // 2], compression, 0, partial=True))
    assert 0 < len(part) < len(DATA)
    assert DATA.startswith(part)
    with pytest.raises(ValueError, match='its header says'):
        decompress_chunk(packed, compression, len(DATA) + 1)


def test_damage_is_told() -> None:
    with pytest.raises(ValueError, match='does not decompress'):
        decompress_chunk(memoryview(b'no frame at all'), 'zstd', 3)
    with pytest.raises(ValueError, match="compression 'brotli' is none of"):
        decompress_chunk(memoryview(b''), 'brotli', 0)
    assert decompress_message(compress_chunk(DATA, 'zstd')) == DATA
    assert decompress_message(b'no frame at all') == b''


def test_a_compressed_file_is_read_again_and_as_far_as_it_goes(tmp_path: Path) -> None:
    path = tmp_path / 'a.zstd'
    packed = compress_chunk(DATA, 'zstd')
    path.write_bytes(packed)
    with ZstdFile(path) as file:
        assert file.readall() == DATA
        file.seek(1000)
        assert file.read(5) == DATA[1000:1005]
        assert not file.damage
    path.write_bytes(packed[:-40_000])
    with ZstdFile(path) as file:
        part = file.readall() or b''
    assert 0 < len(part) < len(DATA)
    assert DATA.startswith(part)
