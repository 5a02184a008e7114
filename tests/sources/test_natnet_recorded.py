"""Real bytes of Motive 2.1 (NatNet 3.0), with numbers read off the bytes by hand."""

from pathlib import Path
from struct import unpack

import numpy as np
import pytest

from retarget.sources.natnet_decoder import NatnetDecoder
from retarget.sources.natnet_wire import (
    BodyDefinition,
    Definitions,
    MessageId,
    ServerInfo,
    Version,
    connect_message,
    message,
    read_definitions,
    read_frame,
    read_server_info,
)

V3 = Version(3, 0)
CLOCK_HZ = 0x328C93


@pytest.fixture(scope="module")
def recorded(shared: Path) -> Path:
    folder = shared / "streams" / "natnet"
    if not folder.is_dir():
        pytest.skip(f"no recorded streams at {folder}")
    return folder


def single(word: str) -> float:
    """A little-endian float32 as it stands in the bytes."""
    return float(unpack("<f", bytes.fromhex(word))[0])


def learned(recorded: Path) -> NatnetDecoder:
    decoder = NatnetDecoder()
    for name in ("serverinfo", "modeldef"):
        assert decoder.decode((recorded / f"{name}_packet_v3.bin").read_bytes()) == []
    return decoder


def test_a_frame(recorded: Path) -> None:
    decoder = learned(recorded)
    (found,) = decoder.decode((recorded / "mocapframe_packet_v3.bin").read_bytes())
    assert found.names == ("rigid://RaceQuad",)
    assert found.number == 0x27BAE
    assert found.tracked.tolist() == [True]
    assert found.stamp == 0x149CDD813D6 / CLOCK_HZ
    x, y, z = single("24a2323e"), single("9a3bb93f"), single("59fb3bbf")
    np.testing.assert_array_equal(found.position, [[z, x, y]])
    qx, qy, qz, qw = (single(word) for word in ("349e5fbd", "f78b023f", "8402333d", "cb7b5bbf"))
    np.testing.assert_allclose(found.orientation, [[qw, qz, qx, qy]], atol=2e-7)
    assert np.linalg.norm(found.orientation) == pytest.approx(1.0, abs=1e-12)
    assert decoder.dropped.count == 0
    assert not decoder.names_missing


def test_a_frame_with_hidden_markers(recorded: Path) -> None:
    decoder = learned(recorded)
    (found,) = decoder.decode((recorded / "mocapframe_packet_occluded_v3.bin").read_bytes())
    assert found.names == ("rigid://#7",)
    assert found.number == 0x41ACF
    assert found.tracked.tolist() == [True]
    x, y, z = single("aad41dbe"), single("24de903e"), single("eafaf03e")
    np.testing.assert_array_equal(found.position, [[z, x, y]])
    assert found.stamp == 0x7DC303DF8E3 / CLOCK_HZ
    assert decoder.names_missing


@pytest.mark.parametrize(("name", "size"), [("mocapframe", 336), ("mocapframe_occluded", 365)])
def test_every_byte_of_a_frame_is_used(recorded: Path, name: str, size: int) -> None:
    stem = name.replace("mocapframe", "mocapframe_packet")
    whole = (recorded / f"{stem}_v3.bin").read_bytes()
    assert len(whole) == size
    found = read_frame(whole[4:], V3)
    assert found is not None
    assert found.surplus == 0
    assert found.flags == 0 < found.mid_exposure


@pytest.mark.parametrize("name", ["mocapframe_packet", "mocapframe_packet_occluded"])
def test_an_untracked_body(recorded: Path, name: str) -> None:
    """The one bit that says a body is hidden."""
    whole = bytearray((recorded / f"{name}_v3.bin").read_bytes())
    found = read_frame(bytes(whole[4:]), V3)
    assert found is not None
    at = bytes(whole).index(found.poses) + 36
    assert whole[at] == 1
    whole[at] = 0
    (frame,) = NatnetDecoder().decode(bytes(whole))
    assert frame.tracked.tolist() == [False]


def test_the_server(recorded: Path) -> None:
    payload = (recorded / "serverinfo_packet_v3.bin").read_bytes()[4:]
    assert len(payload) == 279
    assert read_server_info(payload) == ServerInfo("Motive", (2, 1, 0, 0), V3, CLOCK_HZ, 1511, True, "239.255.42.99")


def test_the_definitions(recorded: Path) -> None:
    payload = (recorded / "modeldef_packet_v3.bin").read_bytes()[4:]
    assert read_definitions(payload, V3) == Definitions(rigid_bodies=(BodyDefinition("RaceQuad", 2, -1, (0, 0, 0)),))


def test_questions_are_as_the_real_client_asks_them(recorded: Path) -> None:
    real, ours = (recorded / "connect_packet_v3.bin").read_bytes(), connect_message()
    assert len(real) == len(ours)
    assert (real[:4], real[260:]) == (ours[:4], ours[260:])
    assert (recorded / "requestmodeldef_packet_v3.bin").read_bytes() == message(MessageId.DEFINITIONS_REQUEST)
