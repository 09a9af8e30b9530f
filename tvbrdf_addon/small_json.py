"""Reading JSON that somebody else may have put there.  Imports no bpy."""

from __future__ import annotations

import json
import stat
from pathlib import Path
from typing import Any

__all__ = ("read_json",)

# A report of ten thousand frames has four million letters.
LONGEST = 1 << 23


def read_json(path: Path) -> Any:
    """The content of the file at `path`, which may be anything at all; never waits for it.

    Raises:
        OSError, ValueError: it cannot be read, is no file, no JSON, too long or too deep.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise ValueError("it is not a file")
    with path.open("rb") as file:
        content = file.read(LONGEST + 1)
    if len(content) > LONGEST:
        raise ValueError("it is too long")
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError("it is too deep") from error
