"""Messages of fixed size: byte for byte what CDR asks for."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget.recording.cdr import layout_from, layout_of, schema
from ros2_messages import decoded

KINDS = {"bool": "?", "uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}


def written_out(sec: int, nanosec: int, names: list[str], position: list[float]) -> bytes:
    """A JointState by hand: every primitive at a multiple of its size, counted from behind the header."""
    body = struct.pack("<iI", sec, nanosec)

    def aligned(size: int) -> None:
        nonlocal body
        body += b"\0" * (-len(body) % size)

    def text(value: str) -> None:
        nonlocal body
        aligned(4)
        body += struct.pack("<I", len(value) + 1) + value.encode() + b"\0"

    text("")
    aligned(4)
    body += struct.pack("<I", len(names))
    for name in names:
        text(name)
    aligned(4)
    body += struct.pack("<I", len(position))
    aligned(8)
    body += struct.pack(f"<{len(position)}d", *position) + struct.pack("<II", 0, 0)
    return b"\x00\x01\x00\x00" + body


def test_a_joint_state_is_what_cdr_asks_for() -> None:
    names = ("a", "knee", "l_sho_pitch")
    layout = layout_of("sensor_msgs/msg/JointState", {"name": names, "position": 3})
    rows = layout.rows(2)
    rows["stamp.sec"], rows["stamp.nanosec"] = (1, 2), (10, 20)
    rows["position"] = [[0.5, -1.0, 2.0], [3.0, 4.0, 5.0]]
    size = layout.dtype.itemsize
    assert rows.tobytes()[:size] == written_out(1, 10, list(names), [0.5, -1.0, 2.0])
    assert rows.tobytes()[size:] == written_out(2, 20, list(names), [3.0, 4.0, 5.0])


SERVOS = "retarget_msgs/msg/Servos"
LINES = schema(SERVOS).partition("=" * 80)[0].splitlines()
SEQUENCES = {name for kind, name in map(str.split, LINES) if kind.endswith("[]") and kind.removesuffix("[]") in KINDS}


@given(st.fixed_dictionaries({}, optional={name: st.integers(0, 5) for name in sorted(SEQUENCES)}))
def test_sequences_are_what_cdr_asks_for(counts: dict[str, int]) -> None:
    rows = layout_of("retarget_msgs/msg/Servos", counts).rows(1)
    for name in set(SEQUENCES) & set(rows.dtype.names or ()):
        rows[name] = 1
    message = decoded(SERVOS, rows.tobytes())
    assert {name: list(getattr(message, name)) for name in SEQUENCES} == {
        name: [1] * counts.get(name, 0) for name in SEQUENCES
    }


def test_the_description_of_a_layout_is_enough_to_read_it() -> None:
    layout = layout_of("geometry_msgs/msg/PoseArray", {"frame_id": "world", "poses": 2})
    assert layout_from(layout.description) == layout.dtype
    rows = layout.rows(1)
    rows["poses"] = np.arange(14).reshape(1, 2, 7)
    again = np.frombuffer(rows.tobytes(), dtype=layout_from(layout.description))
    np.testing.assert_array_equal(again["poses"], rows["poses"])


@pytest.mark.parametrize("description", ["", "{}", "[]", '{"names": 3}'])
def test_what_is_no_layout_is_an_error(description: str) -> None:
    with pytest.raises((ValueError, TypeError, KeyError)):
        layout_from(description)
