"""The skeleton that a sender tells beside its poses, where it does."""

from retarget.frames import Skeleton
from retarget.sources.mvn import MvnDecoder
from retarget.sources.stream_frame import StreamDecoder

__all__ = ["told_skeleton"]


def told_skeleton(decoder: StreamDecoder) -> Skeleton | None:
    """The performer's joints at rest, as far as the stream has told them; None where it tells none.

    Xsens MVN tells them in datagrams of type 13, the T-pose that its own calibration measured.
    """
    if isinstance(decoder, MvnDecoder) and decoder.rest is not None:
        return decoder.rest.skeleton()
    return None
