"""Messages about changes of validity."""

from retarget.live.sensor_validity import ValidityChange, ValidityState, net_changes, sentences

FRESH, STALE, SWAPPED = ValidityState.FRESH, ValidityState.STALE, ValidityState.SWAPPED


def test_sensors_that_change_alike_share_a_message() -> None:
    changes = [ValidityChange(1.0, name, FRESH, STALE, 0.16) for name in ("head", "pelvis")]
    assert sentences(changes) == ["head, pelvis: nothing that can be used for 0.2 s"]
    assert len(sentences([changes[0], ValidityChange(2.0, "pelvis", FRESH, STALE, 0.16)])) == 2


def test_pairs_that_changed_places() -> None:
    changes = [ValidityChange(1.0, name, FRESH, SWAPPED) for name in ("l_wrist", "r_wrist", "l_ankle", "r_ankle")]
    assert sentences(changes) == [
        "l_wrist and r_wrist have changed places: the robot holds until they change back",
        "l_ankle and r_ankle have changed places: the robot holds until they change back",
    ]


def test_every_state_has_a_message() -> None:
    for before in ValidityState:
        for after in set(ValidityState) - {before}:
            (text,) = sentences([ValidityChange(1.0, "l_wrist", before, after, 0.25)])
            assert text.startswith("l_wrist") and len(text) > len("l_wrist: ") and "nan" not in text


def test_messages_of_sensors_that_come_back() -> None:
    assert sentences([ValidityChange(1.0, "head", STALE, FRESH)]) == ["head: back"]
    assert sentences([ValidityChange(1.0, "head", ValidityState.NOT_IN_USE, FRESH)]) == ["head: received now"]
    assert sentences([ValidityChange(1.0, "head", ValidityState.JUMPED, FRESH, resettled=True)]) == [
        "head: accepted again at its new place"
    ]
    assert sentences([ValidityChange(1.0, "head", ValidityState.NOT_IN_USE, STALE)]) == ["head: not received yet"]


def test_what_came_and_went_has_no_message() -> None:
    gone = [ValidityChange(1.0, name, FRESH, STALE, 0.3) for name in ("head", "pelvis")]
    back = [ValidityChange(1.1, "head", STALE, FRESH)]
    assert net_changes([*gone, *back]) == gone[1:] and net_changes(gone) == gone and net_changes([]) == []
    jumped = [ValidityChange(1.0, "head", FRESH, ValidityState.JUMPED)]
    settled = [ValidityChange(1.2, "head", ValidityState.JUMPED, FRESH, resettled=True)]
    assert net_changes([*jumped, *settled]) == [*jumped, *settled]
