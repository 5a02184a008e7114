"""`retarget stop` from the command line: confirmed, not confirmed, no run."""

import threading
from pathlib import Path

import pytest

from hardware.clock import MonotonicClock
from messages import shows
from retarget.cli import main
from retarget.run.control_socket import ControlSocket


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ended:
        main(["stop", *words])
    code, said = ended.value.code, capsys.readouterr()
    assert isinstance(code, int)
    return code, said.out + said.err


@pytest.mark.parametrize(
    ("words", "answer", "code", "said"),
    [
        ((), "ok stopping", 0, "ok stopping"),
        (("--torque-off",), "ok torque off", 0, "ok torque off"),
        ((), "what?", 1, "did not confirm it (what?): cut the power"),
    ],
)
def test_a_run_receives_the_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], answer: str, code: int, said: str
) -> None:
    received: list[str] = []
    clock, place = MonotonicClock(), tmp_path / "control"

    def obey(word: str) -> str:
        received.append(word)
        return answer

    with ControlSocket(place) as server:

        def serve() -> None:
            deadline = clock.now() + 5.0
            while not received and clock.now() < deadline:
                server.poll(obey)
                clock.sleep_until(clock.now() + 0.002)

        thread = threading.Thread(target=serve)
        thread.start()
        found = run(capsys, "--socket", str(place), *words)
        thread.join()
    assert found[0] == code and said in found[1]
    assert received == ["torque_off" if words else "stop"]


def test_no_run_listens(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said = run(capsys, "--socket", str(tmp_path / "control"))
    assert code == 2
    shows(said, "--control-socket")
