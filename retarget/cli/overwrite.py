"""`--overwrite`: the one way in which a command replaces a file that is there."""

from typing import Annotated

import typer

__all__ = ["Overwrite"]

Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that are there; else they are refused.")]
"""Of every command that writes files where the user says."""
