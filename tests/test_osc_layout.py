"""Layouts: asked once for datagrams that differ in numbers only, again for all others, and bounded."""

from osc_bytes import bundle, message
from retarget.sources.osc import OscPacket
from retarget.sources.osc_layout import MAX_ALIKE, MAX_LENGTHS, MAX_REMEMBERED, OscLayouts


class Asked:
    """Layouts whose plan is the texts of the datagram; it counts how often it was made."""

    def __init__(self) -> None:
        self.times = 0
        self.layouts = OscLayouts(self.plan)

    def plan(self, packet: OscPacket) -> list[object]:
        self.times += 1
        return [(m.address, m.tags, *(a for a in m.arguments if isinstance(a, str))) for m in packet.messages]


def four(number: float, name: str = "abc", time_tag: int = 1) -> bytes:
    row = message("/a", "sfih", name, number, int(number), int(number))
    return bundle(row, row, row, bundle(row, time_tag=time_tag), time_tag=time_tag)


def test_numbers_and_time_tags_make_no_new_layout() -> None:
    asked = Asked()
    plans = [asked.layouts.of(four(number, time_tag=int(number) + 5)) for number in (0.0, -1.5, 3e5)]
    assert asked.times == 1 and plans[0] is plans[1] is plans[2]


def test_a_text_a_tag_or_a_size_makes_one() -> None:
    asked = Asked()
    base = four(1.0)
    for other in (four(1.0, "abd"), base.replace(b",sfih", b",sfit"), base.replace(b"/a", b"/b")):
        assert asked.layouts.of(base) != asked.layouts.of(other)
    assert asked.times == 4


def test_what_is_remembered_is_bounded() -> None:
    asked = Asked()
    for number in range(20):
        asked.layouts.of(four(1.0, f"{number:03d}"))
    assert len(asked.layouts) == MAX_ALIKE
    for number in range(200):
        asked.layouts.of(four(1.0, "x" * 4 * number))
        assert len(asked.layouts) <= MAX_ALIKE * MAX_LENGTHS
    many = bundle(*[message("/" + "a" * 40, "f", 1.0)] * 500)
    assert len(many) > MAX_REMEMBERED
    before, asked.times = len(asked.layouts), 0
    asked.layouts.of(many)
    asked.layouts.of(many)
    assert asked.times == 2 and len(asked.layouts) == before


def test_nothing_is_remembered_of_what_cannot_be_read() -> None:
    asked = Asked()
    for broken in (b"", b"x", four(1.0)[:-4], bundle(), message("/a", "f", 1.0)):
        asked.layouts.of(broken)
    assert len(asked.layouts) == 0
