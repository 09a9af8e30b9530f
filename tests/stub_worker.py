"""A worker without torch: the real protocol and checks around an ageing that paints flat colours.

Set `TVBRDF_WORKER` to this file.  It stands in for `model_runtime.age`, follows its contract
(`AgeRequest`, `aged.json`, outputs that appear whole) and takes `TVBRDF_STUB_SECONDS`.  Needs the
standard library only, so that it runs in any Blender's Python.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import struct
import sys
import tempfile
import time
import types
from dataclasses import dataclass
from pathlib import Path

# The worker is started in the folder that holds model_runtime.
sys.path.insert(0, str(Path.cwd()))

from model_runtime.cli import main
from model_runtime.errors import Cancelled, InputError

SIDE = 16


@dataclass(frozen=True)
class AgeRequest:
    input: Path
    ntm: str
    output: Path
    frames: int = 36
    size: int | None = None
    quality: str = "balanced"
    tolerance: float = 45.0
    temporal_model: str = "auto"
    onset: str = "auto"
    specular: str = "rgb"
    format: str | None = None
    sparse: bool = False
    seed: int = 0


def age(request: AgeRequest, reporter: object) -> dict:
    if not request.input.exists():
        raise InputError(f"There is no input at {request.input}.", "Check the path.")
    # What a library prints must not reach the protocol.
    with contextlib.suppress(OSError):  # nor matter where it leads nowhere
        print("a library prints this")
        os.write(1, b"and this, from C\n")
    seconds = float(os.environ.get("TVBRDF_STUB_SECONDS", "0.2"))
    request.output.parent.mkdir(parents=True, exist_ok=True)
    prefix = f".{request.output.name}.partial-"
    beside = Path(tempfile.mkdtemp(prefix=prefix, dir=request.output.parent))
    reporter.warning("The stub paints flat colours.")
    files: dict[str, list[str]] = {
        name: [] for name in ("base_color", "metallic", "specular", "roughness")
    }
    for frame in range(1, request.frames + 1):
        if reporter.cancelled():
            shutil.rmtree(beside)
            raise Cancelled
        time.sleep(seconds / request.frames)
        t = (frame - 1) / max(request.frames - 1, 1)
        pixels = {
            "base_color": (0.6 - 0.3 * t, 0.6 - 0.5 * t, 0.6 - 0.55 * t),
            "metallic": (1.0 - t,),
            "specular": (0.5,),
            "roughness": (0.3 + 0.6 * t,),
        }
        for name, values in pixels.items():
            files[name].append(f"{name}_{frame:04d}.exr")
            write_exr(beside / files[name][-1], values)
        reporter.progress("modelling the change" if t < 0.5 else "writing", frame / request.frames)
    aged = {
        "format": "principled",
        "ntm": request.ntm,
        "frames": request.frames,
        "times": [k / max(request.frames - 1, 1) for k in range(request.frames)],
        "size": [SIDE, SIDE],
        "quality": request.quality,
        "temporal_model": "affine",
        "palette": 3,
        "plan": [f"Modelled 3 distinct BRDFs instead of {SIDE * SIDE}."],
        "fit_error": 0.0,
        "warnings": ["The stub paints flat colours."],
        "seconds": {"rollout": seconds},
        "peak_rss_mb": 10,
        "files": files,
        "command": f"python -m model_runtime age --temporal-model {request.temporal_model}",
    }
    (beside / "aged.json").write_text(json.dumps(aged))
    shutil.rmtree(request.output, ignore_errors=True)
    beside.rename(request.output)
    return aged


def write_exr(path: Path, values: tuple[float, ...]) -> None:
    """A flat float EXR of SIDE x SIDE pixels without compression (OpenEXR file layout, 2013)."""
    names = "BGR" if len(values) == 3 else "Y"
    samples = values[::-1]
    channels = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for name in names
    )
    window = struct.pack("<4i", 0, 0, SIDE - 1, SIDE - 1)
    header = struct.pack("<II", 20000630, 2)
    for name, kind, data in (
        ("channels", "chlist", channels + b"\0"),
        ("compression", "compression", b"\0"),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1.0)),
    ):
        header += (
            name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
        )
    header += b"\0"
    line = b"".join(struct.pack("<f", sample) * SIDE for sample in samples)
    start = len(header) + 8 * SIDE
    offsets = [start + row * (8 + len(line)) for row in range(SIDE)]
    rows = b"".join(struct.pack("<ii", row, len(line)) + line for row in range(SIDE))
    path.write_bytes(header + struct.pack(f"<{SIDE}Q", *offsets) + rows)


stand_in = types.ModuleType("model_runtime.age")
stand_in.AgeRequest, stand_in.age = AgeRequest, age
sys.modules["model_runtime.age"] = stand_in

if __name__ == "__main__":
    sys.exit(main())
