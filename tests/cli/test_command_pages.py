"""The page of the command line: every command, every option, as `--help` has them."""

from command_pages import command_page, commands
from retarget.cli import COMMANDS
from retarget.cli.servo import COMMANDS as SERVO


def test_every_command_is_documented() -> None:
    page = command_page()
    for command in COMMANDS:
        assert f"\n## retarget {command}\n" in page
    for command in SERVO:
        assert f"\n### retarget servo {command}\n" in page
    assert r"| `--parts whole\|upper` | What follows; 'upper' keeps the legs still. | `whole` |" in page
    assert (
        "| `--robot NAME\\|PATH` | Robot by name or path; 'human' only reconstructs the performer. | **required** |"
        in page
    )


def test_every_option_is_documented_with_its_meaning() -> None:
    page = command_page()
    for words, command in commands():
        assert (command.help or "").strip().splitlines()[0] in page, words
        for one in command.params:
            if one.param_type_name == "option" and one.name != "help":
                assert one.help, f"{words} {one.opts}"
                assert f"| `{one.opts[0]}" in page, f"{words} {one.opts}"


def test_choices_are_named_as_they_are_typed() -> None:
    page = command_page()
    assert "Gaps." not in page and "FedBy." not in page and r"--gaps silence\|" in page
