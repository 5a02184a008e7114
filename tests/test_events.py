"""Events on their way to the file: in order, bounded, and as the log message that tools show."""

from retarget.recording.events import MOST_EVENTS, Event, Events, Level, log_message
from retarget.recording.reading import _log_of
from retarget.recording.schemas import SCHEMAS
from ros2_messages import decoded, parsed

LOG = parsed("rcl_interfaces/msg/Log", SCHEMAS["rcl_interfaces/msg/Log"])


def event(text: str, *, cycle: int = 3) -> Event:
    return Event(1.0, cycle, Level.WARN, "guard", text)


def test_they_come_in_order_and_once() -> None:
    events = Events()
    for number in range(5):
        events.add(event(str(number)))
    assert [one.text for one in events.take()] == list("01234") and events.take() == [] and events.lost == 0


def test_a_flood_is_counted_and_takes_no_memory() -> None:
    events = Events()
    for number in range(MOST_EVENTS + 7):
        events.add(event(str(number)))
    assert len(events.take()) == MOST_EVENTS and events.lost == 7
    events.add(event("again"))
    assert [one.text for one in events.take()] == ["again"]


def test_a_message_of_the_log() -> None:
    message = decoded(LOG, log_message(event("torque on"), stamp_ns=5 * 10**9 + 7))
    assert message["stamp"] == {"sec": 5, "nanosec": 7} and message["level"] == 30
    assert (message["name"], message["msg"], message["line"]) == ("guard", "torque on", 3)
    assert message["file"] == message["function"] == ""


def test_any_text_can_be_kept() -> None:
    """Of any length and language; what is no Unicode does not end a recording."""
    for text, wanted in (("", ""), ("größer als 90°", "größer als 90°"), ("x" * 5000, "x" * 2000), ("a\udcff", "a?")):
        data = log_message(event(text, cycle=-1), stamp_ns=0)
        message = decoded(LOG, data)
        assert (message["msg"], message["line"]) == (wanted, 0)
        assert _log_of(data) == ("guard", wanted)
