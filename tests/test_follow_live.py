"""A live run from the command line: a real recording in place of a sender, and options that go together or do not."""

import json
from pathlib import Path

import pytest

from live_rig import LiveRig
from retarget.cli import main
from retarget.cli.clutch import Clutch
from retarget.cli.follow_live import _wait_until_wanted, refuse_for_file, sides_are_checked
from retarget.cli.interrupt import StopRequest
from retarget.cli.keys import Keys
from retarget.cli.live_controls import LiveControls
from retarget.errors import UsageError
from retarget.live.begin import LiveOptions
from retarget.live.performer import LivePerformer
from retarget.sources.raw_record import RawWriter
from sim.faults.sender import FakeSender
from support.messages import refuses, shows

SWAPPED = """\
name: swapped
description: The hands' trackers are exchanged.
sensors:
  head:    {joint: head}
  l_wrist: {joint: l_wrist, role: "human://RIGHT_HAND"}
  r_wrist: {joint: r_wrist, role: "human://LEFT_HAND"}
  l_ankle: {joint: l_ankle}
  r_ankle: {joint: r_ankle}
"""


@pytest.fixture
def slimevr(shared: Path) -> str:
    """Somebody who stands still, and raises the left arm to the side two seconds later."""
    return f"replay://{shared}/streams/slimevr/full12_vmc_50hz.udprec.gz?kind=vmc"


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    """Exit code, and what is said."""
    with pytest.raises(SystemExit) as ended:
        main(["run", "--robot", "human", "--countdown", "0", "--end", "0.2", *words])
    code = ended.value.code
    assert isinstance(code, int)
    return code, capsys.readouterr().err


def test_a_real_left_arm_to_the_side_is_not_enough(slimevr: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The recorded arm goes straight to the side: that tells sides, but not whether the world is mirrored."""
    code, said = run(capsys, "--source", slimevr, "--check-sides")
    assert code == 2
    shows(said)


def test_a_real_person_is_kept(
    slimevr: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    words = ("--source", slimevr, "--person", "anna")
    code, said = run(capsys, *words)
    assert code == 0
    shows(said, "1.6")
    assert (tmp_path / "retarget/people/anna.yaml").is_file()
    code, said = run(capsys, *words)
    assert code == 0
    shows(said, "1.6")


def test_exchanged_hands_are_refused(slimevr: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "swapped.yaml"
    file.write_text(SWAPPED)
    code, said = run(capsys, "--source", slimevr, "--performer", str(file), "--check-sides")
    assert code == 2
    shows(said, "wrist")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--recalibrate",), "--recalibrate: nobody is kept without a name"),
        (("--person", "../anna"), "--person: this is no name of a performer"),
        (("--check-sides", "--yes"), "one asks, the other does not"),
    ],
)
def test_what_makes_no_sense_is_refused(
    slimevr: str, words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = run(capsys, "--source", slimevr, *words)
    assert code == 2 and message in said


def test_the_sides_of_whoever_is_there_are_checked() -> None:
    assert sides_are_checked("vmc://:39539", None, yes=False)
    assert not sides_are_checked("vmc://:39539", None, yes=True)
    assert not sides_are_checked("vmc://:39539", asked=False, yes=False)
    assert not sides_are_checked("replay://a.raw", None, yes=False)
    assert sides_are_checked("replay://a.raw", asked=True, yes=False)


def test_a_file_has_no_live_options() -> None:
    refuse_for_file({"--person": None})
    with refuses(UsageError, "--person"):
        refuse_for_file({"--person": "anna", "--recalibrate": None})


def test_what_was_asked_before_it_begins_is_obeyed_before_anything_has_torque() -> None:
    rig = LiveRig(FakeSender(), options=LiveOptions(countdown=0.5, duration=1.0))
    with rig.prepared() as prepared:
        stop, performer = StopRequest(), prepared.samples
        assert isinstance(performer, LivePerformer)
        clutch = Clutch(performer, clock=rig.clock, tell=rig.said.append)
        controls = LiveControls(Keys(), stop, performer, clutch, tell=rig.said.append)
        _wait_until_wanted(clutch, controls.look, performer, rig.clock)
        clutch.pause()
        begun = rig.clock.now()

        def listen() -> None:
            if rig.clock.now() - begun > 1.0:
                clutch.unpause()

        performer.listen = listen  # type: ignore[method-assign]
        _wait_until_wanted(clutch, controls.look, performer, rig.clock)
        assert 1.0 < rig.clock.now() - begun < 1.1
        stop.ask("somebody asked")
        with pytest.raises(KeyboardInterrupt):
            _wait_until_wanted(clutch, controls.look, performer, rig.clock)
        assert not rig.bus.torque_on


def raw(path: Path, *, seconds: float) -> str:
    """Address of so much of a stream."""
    writer, sender = RawWriter(path, url="json://:14150"), FakeSender()
    for tick in range(round(100 * seconds)):
        for datagram in sender.poll(0.01 * tick):
            address, port = datagram.source
            writer.append(datagram.payload, time_ns=round(1e9 * datagram.arrival), address=address, port=port)
        writer.flush()
    writer.close()
    return f"replay://{path}"


def test_the_end_of_a_recorded_stream_is_the_end_of_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Done, and not stopped for want of data: even of a robot, and with time to spare."""
    source, report = raw(tmp_path / "six.raw", seconds=6.0), tmp_path / "report.json"
    with pytest.raises(SystemExit) as ended:
        main(["run", "--robot", "op3", "--countdown", "0", "--source", source, "--report", str(report)])
    told = json.loads(report.read_text())
    assert ended.value.code == 0 and told["stop"]["reason"] is None
    assert 3.0 < told["duration_s"] < 6.0
    shows(capsys.readouterr().err)


def test_a_stream_that_is_over_before_following_begins_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", "--robot", "op3", "--countdown", "0", "--source", raw(tmp_path / "short.raw", seconds=1.2)])
    assert ended.value.code == 0
    shows(capsys.readouterr().err)
