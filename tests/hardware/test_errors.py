"""The root of the error tree and its message."""

from hardware import errors


def test_a_message_says_what_where_found_allowed_and_what_next() -> None:
    text = errors.describe(
        what="id out of range", where="robot.yaml:7", found=300, allowed="0 to 252", then="Scan the bus"
    )
    assert text == "robot.yaml:7: id out of range; found 300; allowed: 0 to 252. Scan the bus."


def test_empty_parts_are_left_out() -> None:
    assert errors.describe(what="no servo answers") == "no servo answers."
