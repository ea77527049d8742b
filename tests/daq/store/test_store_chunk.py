import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from daq.protocol.conversation import Fault, FaultKind, Sample
from daq.store.chunk import (
    END,
    FAULTS,
    batch_of,
    checksum,
    frame,
    from_parquet,
    head,
    opening_in,
    salvage,
    schema_of,
    table_of,
    to_parquet,
    with_opening,
)
from tests.support.store_cases import bits, fault, samples

PLAIN = schema_of("g1", ("g1_mm",))
SCHEMA = with_opening(PLAIN, b'{"run": 1}')
BATCHES = [batch_of(samples(5, 1, 5 * i), PLAIN, 5 * i) for i in range(3)]
FRAMES = [frame(batch, i) for i, batch in enumerate(BATCHES)]
ENDS = [len(head(SCHEMA)) + sum(map(len, FRAMES[:i])) for i in range(4)]
FILE = head(SCHEMA) + b"".join(FRAMES) + END


def assert_true(data: bytes) -> int:
    found = salvage(data, SCHEMA)
    for i, batch in enumerate(found.batches):
        assert batch.schema.equals(PLAIN)
        assert checksum(batch, i) == checksum(BATCHES[i], i)
    assert found.rows == 5 * len(found.batches)
    assert found.damage or not found.unread
    return len(found.batches)


def test_sound_chunk():
    found = salvage(FILE, SCHEMA)
    assert (found.rows, found.closed, found.unread, found.damage) == (15, True, 0, None)
    assert bits(found.batches[1]["g1_mm"]) == bits([s.values[0] for s in samples(5, 1, 5)])


def test_truncated_at_every_byte():
    for length in range(len(FILE)):
        found = salvage(FILE[:length], SCHEMA)
        complete = sum(end <= length for end in ENDS[1:])
        assert assert_true(FILE[:length]) == complete, length
        assert not found.closed
        clean = length in ENDS
        assert (found.damage is None) == clean, length
        assert found.unread == length - max((e for e in ENDS if e <= length), default=0), length


def test_one_bit_flipped_in_every_byte():
    for place in range(len(FILE)):
        data = bytearray(FILE)
        data[place] ^= 1 << (place % 8)
        count = assert_true(bytes(data))
        before = sum(end <= place for end in ENDS[1:])
        assert count >= before, place
        if place < ENDS[0]:
            assert count == 3  # a damaged head costs no batch


@pytest.mark.parametrize("after", [0, 1, 2, 3])
@pytest.mark.parametrize("zeros", [1, 4, 8, 64, 4096])
def test_zeros_at_a_batch_boundary_are_no_clean_end(after, zeros):
    found = salvage(FILE[: ENDS[after]] + bytes(zeros), SCHEMA)
    assert (len(found.batches), found.closed, found.unread) == (after, False, zeros)
    assert found.damage


def test_batches_lost_from_the_middle_or_moved_are_caught():
    start = head(SCHEMA)
    assert salvage(start + FRAMES[0] + FRAMES[2] + END, SCHEMA).rows == 5
    assert salvage(start + FRAMES[1] + FRAMES[0] + END, SCHEMA).rows == 0
    assert salvage(FILE + FRAMES[0], SCHEMA).damage


@given(st.integers(0, len(FILE)), st.integers(1, 600), st.sampled_from([0, 0xFF, 0x7F]))
@example(0, len(FILE), 0)
def test_overwritten_range(place, length, value):
    data = FILE[:place] + bytes([value]) * length + FILE[place + length :]
    assert assert_true(data) >= sum(end <= place for end in ENDS[1:])


@given(st.binary(max_size=300), st.integers(0, len(FILE)))
def test_any_bytes(junk, place):
    assert_true(junk)
    assert_true(FILE[:place] + junk)
    opening_in(junk)
    assert from_parquet(b"PAR1" + junk + b"PAR1") is None


@pytest.mark.parametrize("length", [b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\xff\xff\xff\xff"])
def test_huge_length_in_a_header(length):
    place = ENDS[1] + 4
    assert assert_true(FILE[:place] + length + FILE[place + 4 :]) == 1


def test_parquet_keeps_every_bit_and_the_opening():
    table = table_of(tuple(BATCHES), SCHEMA)
    data = to_parquet(table)
    back = from_parquet(data)
    assert back["g1_mm"].to_numpy().tobytes() == bits([s.values[0] for s in samples(15)])
    assert opening_in(data) == opening_in(FILE) == b'{"run": 1}'


def test_damaged_opening_is_none():
    assert opening_in(FILE.replace(b'"run": 1', b'"run": 2')) is None


def test_faults_and_odd_codes():
    schema = schema_of(FAULTS, ())
    surrogate = Fault(FaultKind.DEVICE_ERROR, 7, "\udcff", 2)
    batch = batch_of([("g1", fault()), ("g2", surrogate)], schema, 5)
    assert batch["detail"].to_pylist()[1] == "\\udcff"
    assert batch["sequence"].to_pylist() == [5, 6]
    found = salvage(head(schema) + frame(batch, 0), schema)
    assert found.batches[0].equals(batch)
    unsigned = Sample((1.0,), 0, 0, 0, 1, status=0xFFFF_FFFF)
    assert batch_of([unsigned], PLAIN, 0)["status"].to_pylist() == [-1]
