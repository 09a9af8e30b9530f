"""Environment maps in Radiance's `.hdr` format (Ward, Graphics Gems II, "Real Pixels")."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from model_runtime.errors import InputError

__all__ = ("read_radiance",)


def read_radiance(path: Path) -> np.ndarray:
    """Linear RGB [H, W, 3], float64, of a run-length encoded RGBE file with rows from the top."""
    data = np.frombuffer(path.read_bytes(), np.uint8)
    try:
        head = bytes(data[:4096])
        start = head.index(b"\n\n") + 2
        end = head.index(b"\n", start)
        axis_y, height, axis_x, width = head[start:end].split()
        if (axis_y, axis_x) != (b"-Y", b"+X"):
            raise ValueError("its rows do not run from the top left")
        rows = _rows(data, end + 1, int(height), int(width))
    except (ValueError, IndexError) as error:
        raise InputError(
            f"{path.name} is not a Radiance map ({error}).", "Get it again."
        ) from error
    return rows[..., :3] * np.exp2(rows[..., 3:].astype(np.float64) - 136)


def _rows(data: np.ndarray, at: int, height: int, width: int) -> np.ndarray:
    """Decode `height` scan lines from `data[at:]`: uint8 [height, width, 4]."""
    rows = np.empty((height, 4, width), np.uint8)
    for row in rows:
        if bytes(data[at : at + 4]) != bytes((2, 2, width >> 8, width & 255)):
            raise ValueError("a scan line is not run-length encoded")
        at += 4
        for channel in row:
            x = 0
            while x < width:
                count = int(data[at])
                if count > 128:
                    channel[x : x + count - 128] = data[at + 1]
                    x, at = x + count - 128, at + 2
                else:
                    channel[x : x + count] = data[at + 1 : at + 1 + count]
                    x, at = x + count, at + 1 + count
    return rows.transpose(0, 2, 1)
