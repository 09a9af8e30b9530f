"""A worker without torch: the real protocol and checks around an aging that paints flat colors.

Set `TVBRDF_WORKER` to this file.  It stands in for `model_runtime.age`, follows its contract
(`AgeRequest`, `aged.json`, outputs that appear whole) and takes `TVBRDF_STUB_SECONDS`.  Needs the
standard library only, so that it runs in any Blender's Python.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import shutil
import struct
import sys
import time
import types
import zlib
from collections.abc import Callable
from pathlib import Path

# The worker is started in the folder that holds model_runtime.
sys.path.insert(0, str(Path.cwd()))

from model_runtime import __version__
from model_runtime.cli import main
from model_runtime.contract import (
    AFFINE,
    CPU,
    CURVES,
    FRAMES,
    LIVE,
    LOOKS,
    OF_TEXTURE,
    PRINCIPLED,
    REPORT,
    STAGES,
    TIMING,
    TORCH,
    AgeRequest,
    coefficients_file,
    frame_file,
    option,
    staging_places,
)
from model_runtime.errors import Cancelled, InputError

SIDE = 16


def age(request: AgeRequest, reporter: object) -> dict:
    reporter.progress(STAGES["read"], 0.0)
    if not request.input.exists():
        raise InputError(f"There is no input at {request.input}.", "Check the path.")
    # What a library prints must not reach the protocol.
    with contextlib.suppress(OSError):  # nor matter where it leads nowhere
        print("a library prints this")
        os.write(1, b"and this, from C\n")
    seconds = float(os.environ.get("TVBRDF_STUB_SECONDS", "0.2"))
    request.output.parent.mkdir(parents=True, exist_ok=True)
    beside, _ = staging_places(request.output, secrets.token_hex(4))
    beside.mkdir()
    reporter.warning("The stub paints flat colors.")
    live = request.binding == LIVE
    files = _live(beside) if live else {}
    for frame in range(1, request.frames + 1):
        if reporter.cancelled():
            shutil.rmtree(beside)
            raise Cancelled
        time.sleep(seconds / request.frames)
        t = (frame - 1) / max(request.frames - 1, 1)
        if not live:
            _write_frame(beside, files, frame - 1, t)
        stage = STAGES["model" if t < 0.5 else "write"]
        reporter.progress(stage, frame / request.frames)
    aged = {
        "format": PRINCIPLED,
        "binding": LIVE if live else FRAMES,
        "coefficients": int(live),
        "ntm": request.ntm,
        "frames": request.frames,
        "times": [k / max(request.frames - 1, 1) for k in range(request.frames)],
        "size": [SIDE, SIDE],
        "quality": request.quality,
        "temporal_model": AFFINE,
        "device": CPU,
        "backend": TORCH,
        "palette": 3,
        "plan": [f"Modeled 3 texels for all {SIDE * SIDE}."],
        "fit_error": 0.0,
        "warnings": ["The stub paints flat colors."],
        "seconds": dict.fromkeys(("read", "onset", "model", *["fit"] * live, "write"), seconds / 4),
        "peak_rss_mb": 10,
        "files": files,
        "command": _command(request),
        "version": __version__,
        "seed": request.seed,
        "onset": request.onset,
        "tolerance": request.tolerance,
        "hashes": {},
        "height": False,
        "tile_side": 1.0,
        "tile_unit": OF_TEXTURE,
    } | ({"error_db": 60.0, "grain": 0} if live else {})
    (beside / REPORT).write_text(json.dumps(aged))
    shutil.rmtree(request.output, ignore_errors=True)
    beside.rename(request.output)
    return aged


def _command(request: AgeRequest) -> str:
    """The words of it that the add-on reads."""
    apart = [option("timing_apart")] if request.timing_apart else []
    told = ("temporal_model", "binding")
    values = [word for name in told for word in (option(name), getattr(request, name))]
    return " ".join(["age", *values, *apart])


def look(request: AgeRequest, reporter: object) -> dict:
    """Gray pictures of one pixel."""
    reporter.progress(STAGES["read"], 0.0)
    if request.surface is None:
        raise InputError("There is no surface.", "Show the material on something.")
    request.output.mkdir(parents=True, exist_ok=True)
    for name in LOOKS:
        (request.output / name).write_bytes(_png(1, b"\x80"))
    return {"pictures": [*LOOKS]}


def _png(side: int, pixel: bytes) -> bytes:
    """A square of this gray or RGB pixel (PNG specification, 2003)."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">2I5B", side, side, 8, 2 if len(pixel) == 3 else 0, 0, 0, 0)
    pixels = zlib.compress((b"\0" + pixel * side) * side)
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        (chunk(b"IHDR", header), chunk(b"IDAT", pixels), chunk(b"IEND", b""))
    )


def _write_frame(folder: Path, files: dict[str, list[str]], k: int, t: float) -> None:
    pixels = {
        "base_color": (0.6 - 0.3 * t, 0.6 - 0.5 * t, 0.6 - 0.55 * t),
        "metallic": (1.0 - t,),
        "specular": (0.5,),
        "roughness": (0.3 + 0.6 * t,),
    }
    for name, values in pixels.items():
        file = frame_file(name, k)
        files.setdefault(name, []).append(file)
        write_exr(folder / file, [[values] * SIDE] * SIDE)


def _live(folder: Path) -> dict[str, object]:
    """Everything darkens to half of what it was, everywhere at once, and a little by one shape."""
    gain, nothing = [(1.0,) * 3, (0.5,) * 3], [(0.0,) * 3] * 2
    shape = [(0.0,) * 3, (0.1,) * 3]
    write_exr(folder / CURVES, [gain] * 3 + [nothing] * 3 + [shape] * 3)
    write_exr(folder / TIMING, [[(0.0, 1.0, 0.0)] * SIDE] * SIDE)
    (folder / coefficients_file(0)).write_bytes(_png(SIDE, bytes((51, 0, 0))))
    return {"curves": CURVES, "timing": TIMING, "coefficients": [coefficients_file(0)]}


def write_exr(path: Path, rows: list[list[tuple[float, ...]]]) -> None:
    """A float EXR of these pixels, its first row on top, without compression (OpenEXR file layout,
    2013).
    """
    height, width, count = len(rows), len(rows[0]), len(rows[0][0])
    channels = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1)
        for name in ("BGR" if count == 3 else "Y")
    )
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
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
    lines = [
        b"".join(struct.pack(f"<{width}f", *(p[c] for p in row)) for c in reversed(range(count)))
        for row in rows
    ]
    start = len(header) + 8 * height
    offsets = [start + row * (8 + len(lines[0])) for row in range(height)]
    body = b"".join(struct.pack("<ii", i, len(line)) + line for i, line in enumerate(lines))
    path.write_bytes(header + struct.pack(f"<{height}Q", *offsets) + body)


def stand_in(ages: Callable[..., dict]) -> None:
    """Let this process's worker age by `ages`, whatever was kept, and look by `look`."""

    def age_or_take(request: AgeRequest, reporter: object, kept: object) -> dict:
        return ages(request, reporter)

    for name, contents in (
        ("age", {"age": ages, "computes": lambda: ("Flat Colors 1.0", CPU)}),
        ("keeping", {"age_or_take": age_or_take}),
        ("look", {"look": look}),
    ):
        module = types.ModuleType(f"model_runtime.{name}")
        vars(module).update(contents)
        sys.modules[f"model_runtime.{name}"] = module


if __name__ == "__main__":
    stand_in(age)
    sys.exit(main())
