"""Model files put together byte by byte after the safetensors format.

Eight bytes of header length, a JSON header, tensors.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

CARD = {
    "format": "tvbrdf-ntm",
    "version": 1,
    "name": "moss",
    "title": "Moss",
    "description": "Grows",
    "process": "moss",
    "frames": 36,
    "representation": "0123456789abcdef",
    "temporal_model": "affine",
    "domain": {"ranges": {"alpha": [0.1, 0.4]}},
    "source": "made up",
    "license": "CC0-1.0",
    "trained": {"seed": 0},
}
WEIGHT = {"weight": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}}


def model_bytes(
    card: Any = CARD, *, tensors: Mapping[str, Any] = WEIGHT, data: bytes = bytes(8)
) -> bytes:
    header = {"__metadata__": {"card": json.dumps(card)}, **tensors}
    return framed(json.dumps(header).encode(), data)


def framed(header: bytes, data: bytes = b"") -> bytes:
    header += b" " * (-len(header) % 8)
    return struct.pack("<Q", len(header)) + header + data


def stored(tmp_path: Path, content: bytes, name: str = "moss.safetensors") -> Path:
    path = tmp_path / name
    path.write_bytes(content)
    return path
