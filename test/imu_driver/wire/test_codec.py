# SPDX-License-Identifier: Apache-2.0
"""The decoder takes any bytes and returns only frames that were sent."""

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_driver.wire.codec import FrameDecoder, encode
from imu_driver.wire.frames import (
    AcknowledgementFrame,
    CommandFrame,
    DataFrame,
    Frame,
    InformationFrame,
    OtherVersion,
)

U8, U16, U32 = (st.integers(0, (1 << bits) - 1) for bits in (8, 16, 32))
I16 = st.integers(-32768, 32767)
DATA = st.builds(DataFrame, U16, U32, st.integers(0, 15), I16, st.tuples(*[I16] * 9))
SERIAL = st.text(
    st.characters(min_codepoint=0x21, max_codepoint=0x7E, exclude_characters=',*$'),
    min_size=1,
    max_size=16,
)
INFORMATION = st.builds(
    InformationFrame,
    serial_number=SERIAL,
    streaming=st.booleans(),
    configuration=st.integers(0, 3),
    tick=U32,
    samples=U32,
    firmware=st.tuples(U8, U8, U8),
    tick_rate=U32,
    full_scale=st.tuples(U16, U8, U8),
    output_data_rate=U32,
    magnetometer_rate=U32,
    i2c_errors=U32,
    overruns=U32,
    command_errors=U32,
    supply_millivolts=U16,
    who_am_i=st.tuples(U8, U8),
    registers=st.tuples(*[U8] * 16),
)
FRAME = st.one_of(
    DATA,
    INFORMATION,
    st.builds(AcknowledgementFrame, U8, U8, U8, U32),
    st.builds(CommandFrame, U8, U8, U32),
    st.builds(OtherVersion, st.integers(2, 255)),
)
PROTOCOL = st.sampled_from(['ascii', 'binary'])


def in_chunks(wire: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(wire) + 1) for cut in cuts), len(wire)]
    return [wire[a:b] for a, b in pairwise(edges)]


@given(st.lists(FRAME, max_size=6), PROTOCOL, st.lists(st.integers(0, 1000), max_size=6))
@settings(max_examples=150, deadline=None)
def test_frames_survive_any_cut(frames: list[Frame], protocol: str, cuts: list[int]) -> None:
    wire = b''.join(encode(frame, protocol) for frame in frames)
    for decoder in (FrameDecoder(protocol), FrameDecoder('auto')):
        got = [frame for chunk in in_chunks(wire, cuts) for frame in decoder.feed(chunk)]
        assert got == frames
        assert decoder.counts.errors == 0


@given(st.binary(max_size=600), st.sampled_from(['ascii', 'binary', 'auto']))
@settings(max_examples=300, deadline=None)
def test_noise_is_no_frame(noise: bytes, protocol: str) -> None:
    decoder = FrameDecoder(protocol)
    # Noise that happens to be a frame is one in 65 536 pieces, and hypothesis does not search it.
    assert decoder.feed(noise) == []


@given(st.lists(DATA, min_size=3, max_size=5), PROTOCOL, st.data())
@settings(max_examples=300, deadline=None)
def test_damage_costs_the_frames_it_touches(
    frames: list[DataFrame], protocol: str, data: st.DataObject
) -> None:
    wires = [encode(frame, protocol) for frame in frames]
    wire = b''.join(wires)
    at = data.draw(st.integers(0, len(wire) - 1))
    kind = data.draw(st.sampled_from(['flip', 'drop', 'double', 'insert']))
    if kind == 'flip':
        changed = bytes([wire[at] ^ 1 << data.draw(st.integers(0, 7))])
    else:
        changed = {
            'drop': b'',
            'double': wire[at : at + 1] * 2,
            'insert': data.draw(st.binary(min_size=1, max_size=40)) + wire[at : at + 1],
        }[kind]
    decoder = FrameDecoder(protocol)
    lead = encode(CommandFrame(1, 0), protocol)
    got = decoder.feed(lead + wire[:at] + changed + wire[at + 1 :] + lead)[1:]
    got = [frame for frame in got if isinstance(frame, DataFrame)]
    # One place of damage touches one frame, or two if it is the delimiter between them.
    assert len(got) >= len(frames) - 2
    remaining = iter(frames)
    assert all(frame in remaining for frame in got), 'a frame that was not sent, or out of order'


def test_the_first_piece_is_no_error() -> None:
    frame = DataFrame(1, 2, 3, 4, tuple(range(9)))
    for protocol in ('ascii', 'binary'):
        wire = encode(frame, protocol)
        decoder = FrameDecoder(protocol)
        assert decoder.feed(wire[7:] + wire) == [frame]
        assert decoder.counts.errors == 0
        assert decoder.feed(wire[7:] + wire) == [frame]
        assert decoder.counts.errors == 1


def test_a_line_without_end_does_not_pile_up() -> None:
    for protocol in ('ascii', 'binary'):
        decoder = FrameDecoder(protocol)
        wire = encode(CommandFrame(1, 2), protocol)
        decoder.feed(wire)
        for _ in range(1000):
            decoder.feed(b'x' * 1000)
        assert decoder.feed(wire) == []
        assert decoder.feed(wire) == [CommandFrame(1, 2)]
        assert decoder.counts.errors == 1
        assert decoder.counts.bytes == 1_000_000 + 3 * len(wire)
