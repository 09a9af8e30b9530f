"""Live results made up, and what a shader has to make of them: the formula, texel by texel."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

from model_runtime.brdf import principled
from model_runtime.maps import PrincipledMaps, TorranceSparrowMaps

AGES = 36


def write_image(path: Path, pixels: np.ndarray) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}).write(str(path))


def made_up_live(
    folder: Path,
    kind: str = "principled",
    *,
    count: int = 4,
    size: tuple[int, int] = (16, 16),
    onset: bool = True,
    seed: int = 0,
    grain: int = 0,
    height: bool = False,
    tile_side: float = 0.5,
    earlier: bool = False,
) -> Path:
    """A result with `count` coefficients, the last `grain` of them grain: paint that rusts, more or
    less, and with `height` lifts and sinks. `earlier` ones were floats.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    t = np.linspace(0, 1, AGES)[:, None]
    curves = np.zeros((2 + count, AGES, 7))
    fade = 1 - np.exp(-4 * t)
    curves[0] = 1 - fade * rng.uniform(0.3, 0.9, 7)
    curves[1] = fade * rng.uniform(0.02, 0.3, 7)
    for k in range(count):
        curves[2 + k] = np.sin(np.pi * t * (k + 1) * 0.7) * rng.uniform(-0.1, 0.1, 7)
    rows = np.zeros((2 + count, 3, AGES, 3), np.float32)
    rows[:, 0], rows[:, 1], rows[:, 2, :, 0] = curves[..., :3], curves[..., 3:6], curves[..., 6]
    if height:
        lifted = np.sin(np.pi * np.minimum(1, 3 * t[:, 0]))
        rows[1, 2, :, 1] = 0.004 * lifted - 0.006 * t[:, 0] ** 2
        rows[2:, 2, :, 1] = t[:, 0] * rng.uniform(-0.004, 0.004, (count, 1))
    write_image(folder / "curves.exr", rows.reshape(-1, AGES, 3))
    files: dict[str, object] = {"curves": "curves.exr"}
    if onset:
        timing = np.stack(
            (rng.uniform(0, 0.8, size), rng.uniform(0.6, 1.6, size), np.zeros(size)), -1
        )
        write_image(folder / "timing.exr", timing.astype(np.float16))
        files["timing"] = "timing.exr"
    coefficients = rng.normal(0, 0.7, (*size, 12))
    coefficients[..., count:] = 0
    each, kind_of_file = (3, "exr") if earlier else (4, "png")
    files["coefficients"] = [f"coefficients_{i}.{kind_of_file}" for i in range(-(-count // each))]
    for i, name in enumerate(files["coefficients"]):
        some = coefficients[..., each * i : each * (i + 1)]
        if earlier:
            write_image(folder / name, some.astype(np.float16))
        else:
            levels = np.clip(128 + 60 * some, 0, 255).astype(np.uint8)
            Image.fromarray(levels).save(folder / name)
    aged = {
        "format": kind,
        "binding": "live",
        "coefficients": count,
        "ntm": "rust",
        "frames": AGES,
        "times": np.linspace(0, 1, AGES).tolist(),
        "size": list(size),
        "files": files,
        "warnings": [],
        "grain": grain,
        "height": height,
        "tile_side": tile_side,
        "tile_unit": "texture",
    }
    (folder / "aged.json").write_text(json.dumps(aged))
    return folder


def by_hand(folder: Path, authored: PrincipledMaps, t: float) -> TorranceSparrowMaps:
    """The state at age `t`: y(a) = G(a) y0 + O(a) + sum_k c_k V_k(a), and its limits."""
    start = principled.forward(authored)
    y0 = np.concatenate((start.kd, start.ks, np.sqrt(start.alpha)[..., None]), -1)
    curves, shares = _at(folder, t, authored.size)
    y = curves[0][..., :7] * y0 + curves[1][..., :7]
    for k, change in enumerate(curves[2:]):
        y += shares[..., k : k + 1] * change[..., :7]
    kd, ks = np.maximum(y[..., :3], 0), np.maximum(y[..., 3:6], 0)
    r = np.clip(y[..., 6], 0.01, 1)
    return TorranceSparrowMaps(*(each.astype(np.float32) for each in (kd, ks, r * r)))


def height_by_hand(
    folder: Path, t: float, size: tuple[int, int], *, grain: float = 1.0
) -> np.ndarray:
    """[H, W] at age `t`, in sides of the tile, with so much `grain`."""
    curves, shares = _at(folder, t, size)
    count = json.loads((folder / "aged.json").read_text())["grain"]
    height = curves[1][..., 7].copy()
    for k, change in enumerate(curves[2:]):
        strength = grain if k >= len(curves) - 2 - count else 1.0
        height += strength * shares[..., k] * change[..., 7]
    return height


def _at(folder: Path, t: float, size: tuple[int, int]) -> tuple[list[np.ndarray], np.ndarray]:
    """Gain, offset and shapes [H, W, 8] at the local ages of time `t`, and the coefficients."""
    aged = json.loads((folder / "aged.json").read_text())
    files, count, grain = (aged[each] for each in ("files", "coefficients", "grain"))
    a = np.full(size, t)
    if "timing" in files:
        onset, rate, a0 = np.moveaxis(read(folder / files["timing"]), -1, 0)
        a = a0 + rate * np.maximum(0, t - onset)
    a = np.clip(a, 0, 1)
    rows = read(folder / "curves.exr").reshape(-1, 3, AGES, 3)
    curves = np.concatenate((rows[:, 0], rows[:, 1], rows[:, 2, :, :2]), -1)
    at = np.linspace(0, 1, AGES)
    now = [np.stack([np.interp(a, at, c) for c in curve.T], -1) for curve in curves]
    c = [_coefficients(folder / name) for name in files["coefficients"]]
    c = np.concatenate(c, -1) if c else np.zeros((*a.shape, 0))
    if files["coefficients"] and files["coefficients"][0].endswith(".png"):
        c[..., count - grain : count] -= 128 / 255
    return now, c


def _coefficients(path: Path) -> np.ndarray:
    return read(path) if path.suffix == ".exr" else np.asarray(Image.open(path)) / 255


def read(path: Path) -> np.ndarray:
    return OpenEXR.File(str(path)).channels()["RGB"].pixels[..., :3].astype(np.float64)
