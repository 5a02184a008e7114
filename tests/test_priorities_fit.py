"""A priority file is for a human or for a robot: the wrong one is refused with the file and what to do."""

import re
from pathlib import Path

import pytest

from retarget.cli import main
from retarget.cli.boundary import REFUSED
from retarget.errors import ConfigError
from retarget.priorities import load_priorities
from retarget.priorities_fit import check_for_human
from support.messages import refuses


@pytest.mark.parametrize("name", ["human", "paper"])
def test_the_human_has_files_of_its_own(name: str) -> None:
    check_for_human(load_priorities(name), name)


def test_a_robots_file_moves_no_human() -> None:
    with refuses(ConfigError, "servo.yaml", "l_hand", "r_hand") as caught:
        check_for_human(load_priorities("servo"), "servo")
    assert len(caught.value.problems) > 1


@pytest.mark.parametrize(
    ("robot", "priorities", "message"),
    [
        ("human", "servo", r"servo\.yaml.*nothing that a performer wears"),
        ("op3", "human", r"human\.yaml: .*l_wrist, r_wrist.*leave --priorities out"),
    ],
)
def test_the_wrong_file_is_refused(
    robot: str, priorities: str, message: str, shared: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = str(shared / "mocap" / "cmu_asfamc" / "02_06.amc")
    with pytest.raises(SystemExit) as leaving:
        main(["run", "--robot", robot, "--source", source, "--end", "0.1", "--priorities", priorities])
    error = capsys.readouterr().err
    assert leaving.value.code == REFUSED
    assert re.search(message, error, re.DOTALL), error
