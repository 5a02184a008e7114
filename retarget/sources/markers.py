"""Marker sets as data: which markers make which sensor.

Vicon's names, as in Plug-in Gait and the 41-marker set of the CMU recordings. A sensor is the mean of its markers,
which lie on the skin: a wrist's mean is its centre, an ankle's single marker sits some 4 cm outside of the joint. Of
several groups the first that a file holds whole counts.
"""

from collections.abc import Iterable

from retarget.frames import SENSORS

__all__ = ["KNOWN_MARKERS", "MARKER_GROUPS", "groups_in", "marker_name"]

_MIDDLE: dict[str, tuple[tuple[str, ...], ...]] = {
    "head": (("LFHD", "RFHD", "LBHD", "RBHD"), ("LFHD", "RFHD"), ("HEAD",)),
    "pelvis": (
        ("LASI", "RASI", "LPSI", "RPSI"),
        ("LASI", "RASI", "SACR"),
        ("LFWT", "RFWT", "LBWT", "RBWT"),
        ("LASIS", "RASIS", "LPSIS", "RPSIS"),
    ),
    "chest": (("C7", "T10", "CLAV", "STRN"), ("C7", "CLAV"), ("CLAV", "STRN")),
}
_SIDED: dict[str, tuple[tuple[str, ...], ...]] = {
    "shoulder": (("{s}SHO",),),
    "elbow": (("{s}ELB", "{s}ELBM"), ("{s}ELB",)),
    "wrist": (("{s}WRA", "{s}WRB"), ("{s}WRI",), ("{s}WRA",)),
    "knee": (("{s}KNE", "{s}KNM"), ("{s}KNE", "{s}KNEM"), ("{s}KNE",)),
    "ankle": (("{s}ANK", "{s}MED"), ("{s}ANK", "{s}ANKM"), ("{s}ANK",)),
    "toe": (("{s}TOE",), ("{s}MT1", "{s}MT5")),
}


def _all_groups() -> dict[str, tuple[tuple[str, ...], ...]]:
    groups = dict(_MIDDLE)
    for side in "lr":
        for part, choices in _SIDED.items():
            groups[f"{side}_{part}"] = tuple(tuple(name.format(s=side.upper()) for name in group) for group in choices)
    return {sensor: groups[sensor] for sensor in SENSORS if sensor in groups}


MARKER_GROUPS: dict[str, tuple[tuple[str, ...], ...]] = _all_groups()
"""Sensor -> groups of markers, best first."""


KNOWN_MARKERS: frozenset[str] = frozenset(
    name for groups in MARKER_GROUPS.values() for group in groups for name in group
)
"""Every marker name that some group uses."""


def marker_name(label: str) -> str:
    """Name of a marker without its subject's prefix, in upper case."""
    return label.rpartition(":")[2].strip().upper()


def groups_in(labels: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Sensor -> the group of markers that stands for it, for the sensors that these labels allow."""
    known = set(labels)
    chosen = {}
    for sensor, groups in MARKER_GROUPS.items():
        whole = next((group for group in groups if known.issuperset(group)), None)
        if whole is not None:
            chosen[sensor] = whole
    return chosen
