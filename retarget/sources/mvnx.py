"""Xsens MVN recordings (.mvnx): XML with the pose of each of 23 segments in every frame, z up, x forward, metres.

Frames of segments are unturned in MVN's T-pose, so that is the zero pose of the tree; lengths are those of the frames.
Props and fingers are skipped.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, iterparse

import numpy as np

from retarget import rotations
from retarget.errors import InputError
from retarget.frames import SensorFrames
from retarget.sources.canonical import canonical_frames
from retarget.sources.files import (
    AS_WRITTEN,
    MAX_FRAMES,
    ReadOptions,
    check_frame_count,
    check_rate,
    no_frame_rate,
    numbers,
    read_bytes,
)
from retarget.sources.skeletons import TABLES, JointPoses, tree_of_poses
from retarget.sources.streams.mvn import MAX_SEGMENTS, SEGMENTS
from retarget.types import FloatArray

MVN_PARENTS: Mapping[str, str] = TABLES["mvn_tree"]
"""Segment -> its parent, "" for none."""
MAX_XML_DEPTH = 50
"""Most nested elements: MVNX has 7."""
TOP_OF_HEAD = "pTopOfHead"
"""Point of the head segment at the end of the head."""


@dataclass(eq=False)
class _Subject:
    """labels (n): of all segments. rows: positions (3 n,) and quaternions (4 n,) of each frame. top (3,): of the head,
    in its segment's frame; zero if missing."""

    rate: str = ""
    labels: list[str] = field(default_factory=list)
    rows: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)
    top: FloatArray = field(default_factory=lambda: np.zeros(3))
    others: int = 0


def read_mvnx(path: Path, options: ReadOptions = AS_WRITTEN) -> SensorFrames:
    """Read a motion. Raises InputError with the file and the frame."""
    subject = _parsed(path)
    check_frame_count(len(subject.rows), str(path))
    labels = subject.labels or list(SEGMENTS)
    position = np.array([row[0] for row in subject.rows]).reshape(len(subject.rows), -1, 3)
    turns = np.array([row[1] for row in subject.rows]).reshape(len(subject.rows), -1, 4)
    names = tuple(name for name in MVN_PARENTS if name in labels)
    columns = [labels.index(name) for name in names]
    if missing := [name for name in names if MVN_PARENTS[name] and MVN_PARENTS[name] not in names] or ["Pelvis"] * (
        not names
    ):
        found = ", ".join(filter(None, labels))[:200]
        raise InputError("no whole body of MVN", where=str(path), found=found, allowed=f"all above {missing[0]}")
    pose = JointPoses(position[:, columns], rotations.normalise(turns[:, columns]))
    if not np.isfinite(pose.orientation).all():
        raise InputError("no quaternion", where=str(path), found="four zeros", next_step="Export the recording again")
    tree = tree_of_poses(
        names, tuple(names.index(MVN_PARENTS[name]) if MVN_PARENTS[name] else -1 for name in names), pose
    )
    tree = replace(tree, ends=tuple((subject.top,) if name == "Head" else () for name in names))
    if (rate := options.rate) is None:
        if not subject.rate:
            raise no_frame_rate(str(path), allowed="frameRate")
        rate = check_rate(numbers([subject.rate], f"{path}: frameRate")[0], f"{path}: frameRate")
    else:
        rate = check_rate(rate, "--rate")
    notes = (f"{subject.others + 1} subjects in the file: only the first is read",) if subject.others else ()
    return canonical_frames(
        tree,
        pose,
        unit=1.0,
        rate=rate,
        source=str(path),
        options=options,
        notes=notes,
    )


def _parsed(path: Path) -> _Subject:
    content = read_bytes(path)
    step = "Get the file again, or export it as MVNX from MVN"
    if b"\0" in content:  # UTF-16, which would pass the next check
        raise InputError("not UTF-8", where=str(path), found="a NUL byte", allowed="XML in UTF-8", next_step=step)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise InputError(
            "XML with definitions of its own", where=str(path), found="<!DOCTYPE or <!ENTITY", next_step=step
        )
    subject, depth, is_mvnx, subjects = _Subject(), 0, False, 0
    try:
        for event, element in iterparse(BytesIO(content), events=("start", "end")):
            tag = element.tag.rpartition("}")[2]
            depth += 1 if event == "start" else -1
            if depth > MAX_XML_DEPTH:
                raise InputError(
                    "elements too deeply nested", where=str(path), allowed=f"{MAX_XML_DEPTH} deep", next_step=step
                )
            if event == "start":
                is_mvnx |= tag == "mvnx"
                subjects += tag == "subject"
                if tag == "subject" and subjects == 1:
                    subject.rate = element.get("frameRate", "")
                continue
            if subjects == 1:
                _take(subject, tag, element, path)
            if tag in ("frame", "segment", "joint", "sensor", "ergonomicJointAngle"):
                element.clear()
    except ParseError as error:
        raise InputError(
            "damaged XML", where=f"{path}:{error.position[0]}", found=str(error)[:100], next_step=step
        ) from None
    except (ValueError, LookupError) as error:  # unknown encoding
        raise InputError("damaged XML", where=str(path), found=str(error)[:100], next_step=step) from None
    if not is_mvnx or not subjects:
        raise InputError("not an MVNX file", where=str(path), allowed="<mvnx> with a <subject>", next_step=step)
    subject.others = subjects - 1
    return subject


def _take(subject: _Subject, tag: str, element: Element, path: Path) -> None:
    if tag == "segment":
        if subject.rows:
            raise InputError(
                "a segment after the first frame",
                where=str(path),
                found=repr(element.get("label", "")[:80]),
                allowed="all segments before all frames",
                next_step="Export the recording again",
            )
        subject.labels.append(element.get("label", "")[:80])
        if len(subject.labels) > MAX_SEGMENTS:
            raise InputError("too many segments", where=str(path), allowed=f"up to {MAX_SEGMENTS}")
        for point in element.iter():
            if point.get("label") == TOP_OF_HEAD and subject.labels[-1] == "Head" and len(point):
                subject.top = _numbers(point[0], 3, f"{path}: {TOP_OF_HEAD}")
    elif tag == "frame" and element.get("type", "normal") == "normal":
        where = f"{path}: frame {element.get('index', '') or len(subject.rows)}"[:200]
        if len(subject.rows) >= MAX_FRAMES:
            check_frame_count(MAX_FRAMES + 1, where)
        parts = {child.tag.rpartition("}")[2]: child for child in element}
        if not {"position", "orientation"} <= parts.keys():
            raise InputError(
                "a frame without poses of segments",
                where=where,
                found=", ".join(parts)[:80] or "nothing",
                allowed="position and orientation",
                next_step="Export positions and orientations of segments too",
            )
        count = len(subject.labels) or len(SEGMENTS)
        position = _numbers(parts["position"], 3 * count, where)
        subject.rows.append((position, _numbers(parts["orientation"], 4 * count, where)))


def _numbers(element: Element, count: int, where: str) -> FloatArray:
    words = (element.text or "").split()
    if len(words) != count:
        tag = element.tag.rpartition("}")[2]
        raise InputError(f"wrong number of values in {tag}", where=where, found=len(words), allowed=count)
    return np.array(numbers(words, where))
