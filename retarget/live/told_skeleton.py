"""The skeleton that a sender tells beside its poses, where it does."""

from collections.abc import Sequence

from retarget.frames import Skeleton
from retarget.sources.mvn import MvnDecoder
from retarget.sources.natnet_decoder import NatnetDecoder
from retarget.sources.stream_frame import StreamDecoder

__all__ = ["told_skeleton"]


_BONE = "bone://"


def told_skeleton(decoder: StreamDecoder, names: Sequence[str] = ()) -> Skeleton | None:
    """The performer's joints at rest, as far as the stream has told them; None where it tells none.

    Xsens MVN tells them in datagrams of type 13, the T-pose that its own calibration measured; Motive in the definition
    of a skeleton. names: of the poses that are listened for; the skeleton is the one that they are bones of.
    """
    if isinstance(decoder, NatnetDecoder):
        owners = {name.removeprefix(_BONE).partition("/")[0] for name in names if name.startswith(_BONE)}
        return decoder.rest(owners.pop()) if len(owners) == 1 else None
    if isinstance(decoder, MvnDecoder) and decoder.rest is not None:
        return decoder.rest.skeleton()
    return None
