"""Stand-in until the decoder is merged."""

from retarget.sources.json_pose import JsonPoseDecoder as WebDecoder

__all__ = ["WebDecoder"]
