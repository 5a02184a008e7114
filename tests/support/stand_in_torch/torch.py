"""Stands in for PyTorch where LeRobot's base classes are imported: they name three of its classes, and use none."""


class Tensor:
    """Of no use."""


class device:
    """Of no use."""


class dtype:
    """Of no use."""
