"""What a person is told."""

from retarget.live.sensor_validity import TrustChange, TrustState, lasting, sentences

FRESH, STALE, SWAPPED = TrustState.FRESH, TrustState.STALE, TrustState.SWAPPED


def test_who_changes_alike_is_told_together() -> None:
    changes = [TrustChange(1.0, name, FRESH, STALE, 0.16) for name in ("head", "pelvis")]
    assert sentences(changes) == ["head, pelvis: nothing that can be used for 0.2 s"]
    assert len(sentences([changes[0], TrustChange(2.0, "pelvis", FRESH, STALE, 0.16)])) == 2


def test_pairs_that_changed_places() -> None:
    changes = [TrustChange(1.0, name, FRESH, SWAPPED) for name in ("l_wrist", "r_wrist", "l_ankle", "r_ankle")]
    assert sentences(changes) == [
        "l_wrist and r_wrist have changed places: the robot holds until they change back",
        "l_ankle and r_ankle have changed places: the robot holds until they change back",
    ]


def test_every_state_has_its_words() -> None:
    for before in TrustState:
        for after in set(TrustState) - {before}:
            (text,) = sentences([TrustChange(1.0, "l_wrist", before, after, 0.25)])
            assert text.startswith("l_wrist") and len(text) > len("l_wrist: ") and "nan" not in text


def test_how_it_came_back() -> None:
    assert sentences([TrustChange(1.0, "head", STALE, FRESH)]) == ["head: back"]
    assert sentences([TrustChange(1.0, "head", TrustState.NOT_WORN, FRESH)]) == ["head: heard now"]
    assert sentences([TrustChange(1.0, "head", TrustState.JUMPED, FRESH, resettled=True)]) == [
        "head: believed again where it is now"
    ]
    assert sentences([TrustChange(1.0, "head", TrustState.NOT_WORN, STALE)]) == ["head: not heard yet"]


def test_what_came_and_went_unheard_is_not_told() -> None:
    gone = [TrustChange(1.0, name, FRESH, STALE, 0.3) for name in ("head", "pelvis")]
    back = [TrustChange(1.1, "head", STALE, FRESH)]
    assert lasting([*gone, *back]) == gone[1:] and lasting(gone) == gone and lasting([]) == []
    leapt = [TrustChange(1.0, "head", FRESH, TrustState.JUMPED)]
    settled = [TrustChange(1.2, "head", TrustState.JUMPED, FRESH, resettled=True)]
    assert lasting([*leapt, *settled]) == [*leapt, *settled]
