"""Results of a few gray frames, as a run leaves them, and what lies in and beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from model_runtime.output.stored import StagedResult

GRAY = np.full((4, 4), 0.5, np.float32)


def names(frames: int) -> list[str]:
    return [f"alpha_{k:04d}.exr" for k in range(1, frames + 1)]


def write(folder: Path, frames: int, *, value: float = 0.5) -> None:
    """A whole result."""
    with StagedResult(folder) as staged:
        for name in names(frames):
            staged.write(name, np.full((4, 4), value, np.float32))
        staged.commit({"frames": frames, "files": {"alpha": names(frames)}})


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def leftovers(folder: Path) -> list[str]:
    """What lies beside the result: nothing should."""
    return [path.name for path in folder.parent.iterdir() if path != folder]
