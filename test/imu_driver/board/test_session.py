# SPDX-License-Identifier: Apache-2.0
"""The session takes any frames in any order and accounts for every sample."""

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_driver.board.session import DeviceSession, SessionConfig
from imu_driver.wire.codec import encode
from imu_driver.wire.frames import AcknowledgementFrame, DataFrame, Frame, InformationFrame

EPOCH = 1_700_000_000_000_000_000
U8, U16, U32 = (st.integers(0, (1 << bits) - 1) for bits in (8, 16, 32))
I16 = st.integers(-32768, 32767)
DATA = st.builds(DataFrame, U16, U32, st.integers(0, 15), I16, st.tuples(*[I16] * 9))
INFORMATION = st.builds(
    InformationFrame,
    serial_number=st.sampled_from(['A', 'B']),
    streaming=st.booleans(),
    configuration=st.integers(0, 3),
    tick=U32,
    samples=U32,
    firmware=st.just((1, 0, 0)),
    tick_rate=st.sampled_from([0, 1, 1_000_000, 0xFFFFFFFF]),
    full_scale=st.sampled_from([(245, 2, 4), (2000, 16, 16), (0, 3, 255)]),
    output_data_rate=U32,
    magnetometer_rate=U32,
    i2c_errors=U32,
    overruns=U32,
    command_errors=U32,
    supply_millivolts=U16,
    who_am_i=st.tuples(U8, U8),
    registers=st.tuples(*[U8] * 16),
)
FRAME = st.one_of(DATA, INFORMATION, st.builds(AcknowledgementFrame, U8, U8, U8, U32))
STEP = st.tuples(FRAME, st.integers(-(10**10), 10**10), st.booleans())


@given(st.lists(STEP, max_size=30), st.sampled_from(['', 'A']))
@settings(max_examples=200, deadline=None)
def test_any_frames_in_any_order(steps: list[tuple[Frame, int, bool]], device: str) -> None:
    session = DeviceSession(SessionConfig(device=device, full_scale={'accelerometer': 4.0}))
    now, published = EPOCH, 0
    session.connected(now)
    for frame, wait, reconnects in steps:
        now += wait
        samples = session.feed(encode(frame, 'binary'), now)
        session.outgoing(now)
        if reconnects:
            samples += session.disconnected()
            session.connected(now)
        published += len(samples)
        assert all(sample.stamp <= EPOCH + 10**12 for sample in samples)
    published += len(session.disconnected())
    sequence = session.sequence
    assert published + session.discarded == sequence.received
    assert sequence.received + session.duplicates == sum(
        isinstance(frame, DataFrame) for frame, _, _ in steps
    )
    assert sequence.lost >= 0
