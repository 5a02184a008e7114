"""Nothing arrives."""

import pytest

from doctor_rig import mends, text_of
from retarget.doctor.elsewhere import Stray
from retarget.doctor.silence_findings import silence_findings, stray_finding
from retarget.live.address import parse_address
from retarget.sources.datagram_kinds import Recognised
from support.messages import shows

VMC = Recognised("vmc", "VMC")


def said(text: str, *strays: Stray) -> str:
    return text_of(silence_findings(parse_address(text), strays, seconds=5.0))


def test_on_loopback_the_firewall_is_not_blamed() -> None:
    text = said("vmc://:39539")
    shows(text, "5.0", "127.0.0.1", "UDP", 39539)
    assert "vmc://0.0.0.0:39539?allow=ITS_ADDRESS" in text and "firewall" not in text


def test_on_the_network_it_is() -> None:
    text = said("vmc://0.0.0.0:39539?allow=192.168.1.20")
    shows(text, "192.168.1.20/32")


def test_mvn_over_tcp_has_its_own_option() -> None:
    text = said("mvn://:9763?tcp=127.0.0.1")
    shows(text, "TCP", 9763, "?tcp=ITS_ADDRESS")


def test_motive_is_started_and_asked() -> None:
    shows(said("natnet://127.0.0.1"))
    assert "1511/udp" in said("natnet://192.168.1.5") or "UDP port 1511" in said("natnet://192.168.1.5")
    answered = silence_findings(parse_address("natnet://127.0.0.1"), (), seconds=5.0, answered=True)
    assert answered == []


@pytest.mark.parametrize(
    ("stray", "words"),
    [
        (Stray("192.168.1.20", "192.168.1.5", 39_539, VMC), "vmc://0.0.0.0:39539?allow=192.168.1.20"),
        (Stray("127.0.0.1", "0.0.0.0", 39_540, VMC), "Use vmc://:39540, or let it send to port 39539"),
        (Stray("127.0.0.1", "127.0.0.1", 39_540, VMC), "Use vmc://:39540, or let it send to port 39539"),
        (Stray("192.168.1.20", "0.0.0.0", 39_540, VMC), "Use vmc://0.0.0.0:39540?allow=192.168.1.20"),
        (Stray("192.168.1.20", "0.0.0.0", 1_511, Recognised("natnet", "NatNet")), "Use natnet://192.168.1.20"),
    ],
)
def test_a_sender_to_elsewhere_is_the_cause(stray: Stray, words: str) -> None:
    assert words in "\n".join(mends([stray_finding(parse_address("vmc://:39539"), stray)]))
    assert "ITS_ADDRESS" not in said("vmc://:39539", stray)


@pytest.mark.parametrize(
    ("got", "words"), [(Recognised("mvn", "MVN"), "To use that: mvn://:9763"), (Recognised("", "mocopi"), "not read")]
)
def test_another_kind_elsewhere_is_only_worth_knowing(got: Recognised, words: str) -> None:
    finding = stray_finding(parse_address("vmc://:39539"), Stray("127.0.0.1", "0.0.0.0", 9_763, got))
    assert not mends([finding]) and words in finding.render()
