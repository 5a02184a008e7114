"""Messages of ROS 2 by the library with which its users read MCAP: an oracle for bytes and definitions of ours."""

from typing import Any

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from retarget.recording.cdr import schema


def decoded(name: str, data: bytes) -> Any:
    """A message (pkg/msg/Name) by its definition."""
    of = Schema(id=1, name=name, encoding="ros2msg", data=schema(name).encode())
    decode = DecoderFactory().decoder_for("cdr", of)
    assert decode is not None
    return decode(data)
