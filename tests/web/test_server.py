"""The page's server in its own process, spoken to as browsers do: who is let in, what goes to the run and back."""

import hashlib
import json
import math
import socket
import ssl
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar
from unittest.mock import Mock
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followers import dimensions, op3, performer
from hardware.clock import MonotonicClock, VirtualClock
from hardware.imu import from_roll_pitch_yaw
from messages import shows
from retarget.cli.controls import ControlRequest
from retarget.cli.stick import STAND, Shares
from retarget.cli.web.control import HELD_S, PageControl, directions
from retarget.errors import ConfigError
from retarget.live.admission import Datagram
from retarget.model.human import build_human
from retarget.run.table import RunTable
from retarget.types import FloatArray
from retarget.web.feed import PageSetup, Settings, ViewFeed
from retarget.web.link import PoseReceiver, open_web

client = pytest.importorskip("websockets.sync.client", reason="the extra web is not installed")
from websockets.exceptions import InvalidStatus  # noqa: E402  (where it is installed)

from retarget.web.server import PageServer  # noqa: E402  (needs websockets)

WAIT_S = 20.0
"""How long an answer may take on a busy machine, s: it is there within milliseconds."""
FRAME = '{"axes": "webxr", "quaternion": "xyzw", "time": 1.5, "poses": {"head": {"p": [0, 1.6, 0]}}}'


Known = TypeVar("Known")


class Page:
    """A run's ends of a page, and its address."""

    def __init__(self, feed: ViewFeed, receiver: PoseReceiver) -> None:
        self.feed, self.receiver, self.said = feed, receiver, list[str]()
        self.control = PageControl(feed, self.said.append)
        self.address, _, self.fingerprint = feed.address.partition(" ")
        self.clock = MonotonicClock()

    def until(self, found: Callable[[], Known]) -> Known:
        """What `found` returns once that is true."""
        end = self.clock.now() + WAIT_S
        while not (result := found()):
            assert self.clock.now() < end, self.said
            self.clock.sleep_until(self.clock.now() + 0.002)
        return result

    def poses(self) -> list[Datagram]:
        return self.until(lambda: self.receiver.poll(self.clock.now()))

    def requests(self) -> list[ControlRequest]:
        return self.until(lambda: [one for one, _ in self.control.poll(self.clock.now())])

    def logged(self, text: str) -> bool:
        """Wait until the run's terminal has a line with this text."""

        def found() -> bool:
            self.control.listen()
            return any(text in line for line in self.said)

        return self.until(found)

    @contextmanager
    def browser(self, kind: str = "headset", name: str = "anna", **how: Any) -> Iterator["Browser"]:
        where = urlsplit(self.address)
        how = {"origin": f"{where.scheme}://{where.netloc}"} | how
        scheme = "wss" if where.scheme == "https" else "ws"
        with client.connect(f"{scheme}://{where.netloc}{where.path}ws", open_timeout=WAIT_S, **how) as socket:
            browser = Browser(socket)
            browser.send(type="hello", input=kind, id=name)
            yield browser


def read(data: str | bytes) -> dict[str, Any]:
    """A message, with the numbers behind it as its tracks."""
    if isinstance(data, str):
        return dict(json.loads(data))
    begin = 4 + int.from_bytes(data[:4], "little")
    message, numbers = json.loads(data[4:begin]), np.frombuffer(data[begin:], "<f4")
    ends = np.cumsum([*message["tracks"].values()])
    assert ends[-1] == len(numbers) and begin % 4 == 0
    return dict(message | {"tracks": dict(zip(message["tracks"], np.split(numbers, ends[:-1]), strict=True))})


class Browser:
    """A page of ours, or what claims to be one."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket

    def send(self, **said: Any) -> None:
        self.socket.send(json.dumps(said))

    def receive(self, kind: str) -> dict[str, Any]:
        """The next message of a kind."""
        while True:
            message = read(self.socket.recv(WAIT_S))
            if message["type"] == kind:
                return message


@contextmanager
def steered() -> Iterator[tuple[PageServer, PageControl, VirtualClock]]:
    """A server in this process, and the run's control of it."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        ours.setblocking(False)
        clock = VirtualClock()
        server = PageServer(Settings(listen=False, port=0, robot="op3", stick=True), theirs, None, clock)
        yield server, PageControl(ViewFeed(ours, 0), lambda text: None), clock


@contextmanager
def page(**settings: Any) -> Iterator[Page]:
    with open_web(replace(Settings(listen=False, port=0, robot="op3"), **settings)) as (feed, receiver):
        yield Page(feed, receiver)


@pytest.fixture(scope="module")
def shared() -> Iterator[Page]:
    """A page for tests that leave no trace on it."""
    with page() as one:
        yield one


def fetched(address: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    try:
        with urlopen(Request(address, headers=headers), timeout=WAIT_S) as answer:
            return answer.status, dict(answer.headers), answer.read()
    except HTTPError as error:
        return error.code, dict(error.headers), error.read()


def test_files_are_served_to_who_has_the_key_with_a_policy(shared: Page) -> None:
    status, headers, body = fetched(shared.address)
    assert status == 200 and b"<html" in body and headers["Content-Type"] == "text/html"
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    status, headers, _ = fetched(f"{shared.address}bodies.js")
    assert status == 200 and headers["Content-Type"] == "text/javascript"
    assert fetched(f"{shared.address}base.css")[1]["Content-Type"] == "text/css"
    where = urlsplit(shared.address)
    for place, expected in {
        f"http://{where.netloc}/": 401,
        f"http://{where.netloc}/x{where.path}": 401,
        f"{shared.address}page/../server.py": 404,
        f"{shared.address}page/%2e%2e/server.py": 404,
        f"{shared.address}page//etc/passwd": 404,
        f"{shared.address}runtime/none.js": 404,
        f"{shared.address}page": 404,
    }.items():
        assert fetched(place)[0] == expected, place
    assert fetched(shared.address, Host="evil.example")[0] == 403
    assert shared.logged("a page was refused: this page has another address")


@pytest.mark.parametrize("origin", ["http://evil.example", None])
def test_a_socket_of_another_page_is_refused(shared: Page, origin: str | None) -> None:
    with pytest.raises(InvalidStatus, match="403"), shared.browser(origin=origin):
        pass


@pytest.mark.long
def test_poses_go_on_to_the_run_byte_for_byte() -> None:
    with page() as one, one.browser() as anna, one.browser("watch", "olga") as olga:
        assert anna.receive("welcome")["robot"] == "op3" and olga.receive("welcome")
        olga.socket.send(FRAME)
        before = one.clock.now()
        anna.socket.send(FRAME)
        (only,) = one.poses()
        assert only.payload == FRAME.encode() and only.source == ("127.0.0.1", 1)
        assert before <= only.arrival <= one.clock.now()
        anna.socket.send("x" * 70_000)  # longer than any frame: the connection ends
        with pytest.raises(Exception, match="1009"):
            anna.receive("none")


def test_one_performer_at_a_time_and_the_one_who_was_measured() -> None:
    with page() as one:
        with one.browser(name="anna") as anna:
            anna.receive("welcome")
            with one.browser(name="boris") as boris:
                assert "performer" in boris.receive("refused")["why"]
            assert one.logged("one at a time")
            with one.browser(name="anna") as again:  # the same page, loaded anew or doubled
                assert again.receive("welcome") and anna.receive("refused")
                anna.socket.send(FRAME.replace("1.5", "2.5"))
                again.socket.send(FRAME)
                assert [found.payload for found in one.poses()] == [FRAME.encode()]
        one.logged("the performer's page is gone")
        with one.browser(name="boris") as boris:
            boris.receive("welcome")
            boris.socket.send(FRAME)
            assert one.poses()[0].source == ("127.0.0.1", 2), "another source: the run has its own rule"
            one.feed.begin(PageSetup(None, None, None, human()), rate_hz=100.0)
            with one.browser("watch", "olga") as olga:
                assert olga.receive("scene")["robot"] is None, "who comes later sees it, too"
        assert set(one.requests()) == {ControlRequest.PAGE_HOLD}, "who is measured has gone: it goes on when asked to"
        for kind, name in (("headset", "anna"), ("camera", "boris")):
            with one.browser(kind, name) as other:
                assert "measured" in other.receive("refused")["why"]
        with one.browser(name="boris") as boris:
            boris.receive("welcome")
            boris.socket.send(FRAME)
            assert one.poses()[0].source == ("127.0.0.1", 2)
            assert set(one.requests()) == {ControlRequest.PAGE_HOLD}, "nothing else comes"


def human() -> str:
    return build_human(dimensions(performer())).mjcf


def test_what_a_page_requests_reaches_the_operator_and_a_stop_until_the_run_ends() -> None:
    with page() as one, one.browser("watch", "olga") as olga:
        olga.send(type="pause")
        assert one.requests() == [ControlRequest.PAGE_HOLD]
        olga.send(type="go on")
        assert one.requests() == [ControlRequest.PAGE_GO_ON]
        olga.send(type="stop")
        assert olga.receive("stop"), "it is confirmed"
        for _ in range(3):
            one.feed._stop = False  # as if the run had not received it
            assert one.until(one.feed.stop_requested)
        with pytest.raises(KeyboardInterrupt):
            one.control.look()
        olga.send(type="ping", t=17.5)
        assert olga.receive("pong")["t"] == 17.5


def test_a_dead_man_control_lapses_with_its_page() -> None:
    with page(dead_man=True) as one:
        with one.browser("watch", "olga") as olga:
            assert olga.receive("welcome")["dead_man"]
            olga.send(type="held", held=True)
            assert one.requests() == [ControlRequest.GRIP]
            olga.send(type="held", held=False)
            assert one.requests() == [ControlRequest.RELEASE]
            olga.send(type="held", held=True)
            assert one.requests() == [ControlRequest.GRIP]
            assert one.requests() == [ControlRequest.RELEASE], "the page says nothing any more"
            olga.send(type="held", held=True)
            assert one.requests() == [ControlRequest.GRIP]
        assert one.requests() == [ControlRequest.RELEASE], "the page is gone"


def test_pads_steer_a_run_that_asks_for_them_until_they_are_let_go() -> None:
    with page(performs=False, stick=True) as one, one.browser("watch", "olga") as olga:
        assert olga.receive("welcome")["stick"]

        def shares() -> Shares:
            one.control.listen()
            assert not [*one.control.poll(one.clock.now())]
            return one.control.shares(one.clock.now())

        assert shares() == STAND
        olga.send(type="stick", forward=1, left=-0.25, turn=0.125)
        assert one.until(lambda: shares() == (1.0, -0.25, 0.125))
        assert one.until(lambda: shares() == STAND), "the page says nothing any more"
        olga.send(type="stick", forward=0.5, left=0, turn=0)
        assert one.until(lambda: shares() != STAND)
        olga.send(type="stick", forward=0, left=0, turn=0)
        assert one.until(lambda: shares() == STAND)


def test_one_page_at_a_time_steers() -> None:
    """Messages of another page meanwhile neither turn nor stop the robot."""
    olga, pete = Mock(), Mock()
    with steered() as (server, control, clock):

        def after(client: Mock, forward: float) -> float:
            server.steer(client, {"forward": forward, "left": 0.0, "turn": 0.0})
            assert not [*control.poll(clock.now())]
            return control.shares(clock.now())[0]

        assert after(olga, 0.5) == after(pete, -1.0) == after(pete, 0.0) == 0.5
        assert after(olga, 0.0) == 0.0 and after(pete, -1.0) == -1.0
        clock.sleep_until(clock.now() + 1.0)
        assert after(olga, 0.25) == 0.25, "pete's page says nothing any more"


@pytest.mark.parametrize("performs", [True, False])
def test_no_page_steers_a_run_without_pads(performs: bool) -> None:
    with page(performs=performs) as one, one.browser("watch", "olga") as olga:
        assert not olga.receive("welcome")["stick"]
        olga.send(type="stick", forward=1.0, left=0.0, turn=0.0)
        shows(olga.receive("refused")["why"])
        assert one.control.shares(one.clock.now()) == STAND


JUNK = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.lists(st.floats(), max_size=2)


@settings(max_examples=300)
@given(st.dictionaries(st.sampled_from(["forward", "left", "turn", "up"]), JUNK))
def test_whatever_a_page_asks_for_is_within_range_or_refused(said: dict[str, Any]) -> None:
    shares = [said.get(name) for name in ("forward", "left", "turn")]
    numbers = [one for one in shares if isinstance(one, int | float) and not isinstance(one, bool)]
    is_valid = len(numbers) == 3 and all(-1.0 <= one <= 1.0 for one in numbers)
    with steered() as (server, control, _):
        try:
            server.steer(Mock(), said)
        except Exception:  # noqa: BLE001 - what it raises is private
            assert not is_valid
            return
        assert is_valid
        assert not [*control.poll(0.0)] and all(-1.0 <= share <= 1.0 for share in control.shares(HELD_S))
        assert control.shares(HELD_S + 0.01) == STAND


def test_all_dead_man_controls_are_held_and_lapse_where_the_server_hangs() -> None:
    sent = list[str]()
    control = PageControl(Mock(messages=lambda: [sent.pop(0) for _ in range(len(sent))]), lambda text: None)
    assert not [*control.poll(0.0)], "it is not in use"
    requests: dict[tuple[float, tuple[str, ...]], list[ControlRequest]] = {
        (1.0, ("grip 0",)): [ControlRequest.GRIP],
        (1.2, ("grip 0",)): [],
        (1.19 + HELD_S, ()): [],
        (1.21 + HELD_S, ()): [ControlRequest.RELEASE],
        (2.0, ("grip 0", "release 1")): [],
        (2.1, ("grip 1",)): [ControlRequest.GRIP],
        (9.0, ("grip 1",)): [ControlRequest.RELEASE],
        (9.1, ()): [],
    }
    for (now, words), found in requests.items():
        sent += words
        assert [one for one, _ in control.poll(now)] == found, now


@pytest.mark.long
@pytest.mark.parametrize(
    "messages",
    [
        ["no JSON"],
        ['{"type": "hello", "input": "robot", "id": "x"}'],
        ['{"type": "hello", "input": "camera"}'],
        ["[" * 10_000],
        ['{"type": "hello", "input": "camera", "id": "x"}', '{"type": "torque"}'],
        ['{"type": "hello", "input": "camera", "id": "x"}', '{"type"'],
        ['{"type": "hello", "input": "camera", "id": "x"}', b"\x00\x01"],
    ],
)
def test_what_no_page_of_ours_says_is_refused(shared: Page, messages: list[str | bytes]) -> None:
    where = urlsplit(shared.address)
    with client.connect(f"ws://{where.netloc}{where.path}ws", origin=f"http://{where.netloc}") as socket:
        for message in messages:
            socket.send(message)
        assert "anew" in Browser(socket).receive("refused")["why"]


@pytest.mark.long
def test_a_page_that_does_not_say_what_it_is_is_sent_away(shared: Page) -> None:
    where = urlsplit(shared.address)
    with client.connect(f"ws://{where.netloc}{where.path}ws", origin=f"http://{where.netloc}") as socket:
        why = Browser(socket).receive("refused")["why"]
    assert shared.logged(f"a page was sent away: {why}")


@pytest.mark.long
def test_a_flood_is_sent_away_and_the_run_goes_on() -> None:
    with page() as one:
        with one.browser() as anna:
            anna.receive("welcome")
            with pytest.raises(Exception, match=r"1000|OK"):
                for _ in range(5000):
                    anna.socket.send(FRAME)
                anna.receive("none")
        assert one.logged("messages a second")
        with one.browser() as anna:
            assert anna.receive("welcome"), "it may come back"


@pytest.mark.long
def test_a_new_problem_of_a_page_is_logged_once(shared: Page) -> None:
    with shared.browser("camera", "carla") as carla:
        for _ in range(3):
            carla.send(type="health", trouble="the camera sees two people", rtt_ms=3.0, send_ms=40.0)
        carla.send(type="health", rtt_ms=1e300, send_ms=-1.0, agent="x" * 9000, fps=[1], secure="\n")
        carla.send(type="health", trouble="it is dark")
        assert shared.logged("it is dark")
    assert sum("two" in line for line in shared.said) == 1
    assert [said["rtt_ms"] for said in shared.control.health if "rtt_ms" in said] == [3.0] * 3


def shown_row(
    time: float,
    q: FloatArray,
    doing: str = "following",
    reason: str = "",
    *,
    asked: FloatArray,
    sensors: FloatArray,
) -> RunTable:
    """A tick, as a run hands it to its page; the IMU is not valid where there is a reason."""
    return RunTable(
        time=np.array(time),
        latency=np.array(0.007),
        human_q=build_human(dimensions(performer())).body.qpos0,
        q=q,
        doing=np.array(doing, dtype=np.object_),
        reason=np.array(reason, dtype=np.object_),
        landmarks_asked=asked,
        sensors=sensors,
        imu_orientation=np.array(from_roll_pitch_yaw(math.radians(-3.0), math.radians(8.0), 1.0)),
        imu_valid=np.array(reason == ""),
    )


@pytest.mark.long
def test_robot_and_performer_are_shown_as_the_run_has_them() -> None:
    robot = op3()
    landmarks = tuple(robot.profile.landmarks)
    setup = PageSetup(str(robot.profile.path), None, None, human(), sensors=("head", "l_wrist"), landmarks=landmarks)
    with page() as one, one.browser() as anna:
        one.feed.announce("calibrating")
        assert anna.receive("state")["state"] == "calibrating"
        one.feed.note("Stand upright")
        assert anna.receive("note")["text"] == "Stand upright"
        one.feed.begin(setup, rate_hz=25.0)
        scene = anna.receive("scene")
        goal = robot.posture(robot.profile.postures.stand)
        asked = robot.points(goal[None], robot.landmark_frames(landmarks))[0]
        asked[landmarks.index("l_hand")] += [0.0, 0.0, 0.12]
        sensors = np.array([[0.0, 0.0, 1.6], [np.nan] * 3])
        anna.send(type="health", rtt_ms=4.0)
        one.logged("here")
        one.until(lambda: not [*one.control.poll(0.0)] and one.control.health)

        row = partial(shown_row, asked=asked, sensors=sensors)

        def clipped(time: float, q: FloatArray) -> list[str]:
            one.feed._send(row(time, q))
            return list(anna.receive("state")["clipped"])

        late = goal.copy()
        late[robot.body.joint_qpos[robot.body.joint_index("l_sho_pitch")]] += 0.5
        # A hand that comes is late; one that has stood still for half a second is out of reach.
        assert [clipped(0.1, late), *(clipped(time, goal) for time in (0.4, 0.6, 0.8))] == [[], [], [], []]
        assert clipped(1.0, goal) == ["left hand 12 cm out of reach"]
        one.feed._send(row(1.05, goal))
        assert anna.receive("state")["imu"] == "tilted 8° forward, 3° left"
        one.feed._send(row(1.1, goal, "holding", "l_wrist: lost"))
        state = anna.receive("state")
        assert state["imu"] == "no IMU"
        assert (state["state"], state["why"]) == ("holding", "l_wrist: lost")
        assert state["sensors"] == {"head": True, "l_wrist": False}
        assert state["latency_ms"] == {"page to goal": 9.0}
        assert state["clipped"] == []
        for who in ("human", "robot"):
            poses = state["tracks"][f"{who}.poses"]
            links = {mesh["link"] for mesh in scene[who]["body"]["meshes"]}
            assert len(poses) == 7 * len(links) and np.isfinite(poses).all()
        np.testing.assert_array_equal(state["tracks"]["human.marks"], sensors.ravel().astype("f4"))


def test_the_page_of_a_run_can_only_stop_it() -> None:
    """It cannot perform, pause or hold, and nothing of that reaches the run."""
    with page(performs=False) as one:
        with one.browser("watch", "olga") as olga:
            assert olga.receive("welcome")["performs"] is False
            olga.send(type="ping", t=1.0)
            assert olga.receive("pong")
            olga.send(type="stop")
            assert olga.receive("stop")
            assert one.until(one.feed.stop_requested)
        for said in ({"type": "pause"}, {"type": "held", "held": True}):
            with one.browser("watch", "olga") as olga:
                olga.send(**said)
                assert "anew" in olga.receive("refused")["why"]
        for kind in ("camera", "headset"):
            with one.browser(kind, "anna") as anna:
                assert "anew" in anna.receive("refused")["why"]
        assert not [word for word in one.feed.messages() if not word.startswith("note ")]


@pytest.mark.long
def test_the_end_and_its_reason_are_shown() -> None:
    with ExitStack() as outer:
        with pytest.raises(ConfigError), page() as one:
            anna = outer.enter_context(one.browser())
            anna.receive("welcome")
            raise ConfigError("the left arm was not seen to rise")
        assert "arm" in anna.receive("note")["text"]
        assert anna.receive("state")["state"] == "ended"


@pytest.mark.long
def test_the_network_is_reached_over_https_with_the_certificate_that_is_printed() -> None:
    with page(listen=True) as one:
        where = urlsplit(one.address)
        assert where.scheme == "https" and where.port is not None
        der = ssl.PEM_cert_to_DER_cert(ssl.get_server_certificate(("127.0.0.1", where.port)))
        assert hashlib.sha256(der).hexdigest().upper() == one.fingerprint.replace(":", "")
        assert any(one.fingerprint in line for line in directions(one.address, one.fingerprint))
        trusting = ssl.create_default_context()
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
        with one.browser(ssl=trusting) as anna:
            assert anna.receive("welcome")
