"""The folder of mesh maps that the worker grows aging on, kept as long as the meshes stay."""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..reading.pixels import write_exr
from ..reading.tiles import Tiles
from .collect import Seen, UVMap, collect
from .layout import Layout, free_name, lay_out
from .light import Light, light_on
from .painted import Mask, drawn
from .texels import shrunk, with_margin, write_maps

__all__ = ("SurfaceMaps", "own_uv_map", "write_surface")

Array = NDArray[np.float32]

# Texels a side.
_SIZE = 1024
# Folders that are kept, each of about 40 MB.
_KEPT = 4
_VERSION = b"1"  # of what is written
_LAYOUT, _PLACES = "layout.json", "own.npz"
_MASK, _LIGHT = "mask-", "light-"  # no names by which a worker takes them for the surface's


@dataclass(frozen=True)
class SurfaceMaps:
    """The `folder` of the maps, None where there are none, and what is to be said, in sentences.

    `own` is the UV map that they are laid out in, which the meshes do not have yet; None where it
    is the material's.  `mask` is what an artist painted, in their layout, and `light` what
    falls on them.  They took so many `seconds` to make; 0 where they were kept.
    """

    folder: Path | None
    own: UVMap | None
    notes: tuple[str, ...]
    mask: Path | None = None
    light: Path | None = None
    seconds: float = 0.0


def write_surface(
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    frame: int,
    *,
    uv_map: str | None,
    tiles: Tiles,
    kept: Path,
    alike: bool = False,
    mask: Mask | None = None,
    light: Light | None = None,
    size: int = _SIZE,
) -> SurfaceMaps:
    """Writes `position.exr` (world, meters; alpha 1 where a face is), `normal.exr` (world, unit),
    `ao.exr`, `edge.exr` and `sky.exr` (0 to 1) of all faces that show the material at `frame`, and
    what a `mask` says of them, and how much `light` falls on them.

    `uv_map` and `tiles` say where the material's own maps lie, and `alike` that what shares texels
    is to age alike, as in `lay_out`.  Folders lie in `kept`, the last few of which stay for the
    next time.  Raises `MaterialError`.
    """
    started, made = time.monotonic(), False
    seen = collect(material, scene, frame, uv_map=uv_map or "", mask=mask)
    name = free_name(material)
    how = {"uv_map": uv_map, "tiles": tiles, "alike": alike, "name": name, "size": size}
    folder = kept / _digest(seen, repr(how))
    layout = None
    if not folder.is_dir():
        layout = lay_out(seen, material, scene, frame, **how)
        if not isinstance(layout, Layout):
            return SurfaceMaps(None, None, layout)
        _write(layout, folder)
        made = True
    found = _kept(folder)
    if mask is not None:
        shades = mask.shades()
        path = folder / f"{_MASK}{mask.digest(seen, shades)}.exr"
        if not path.is_file():
            layout = layout or lay_out(seen, material, scene, frame, **how)
            assert isinstance(layout, Layout)  # as it was before
            _write_mask(layout, shades, path)
            made = True
        found = replace(found, mask=path, notes=(*found.notes, *mask.missing(seen)))
    if light is not None:
        path = folder / f"{_LIGHT}{light.digest or ''}.exr"
        if light.digest is None or not path.is_file():
            layout = layout or lay_out(seen, material, scene, frame, **how)
            assert isinstance(layout, Layout)
            _write_light(layout, light, frame, path)
            made = True
        found = replace(found, light=path)
    folder.touch()
    for old in sorted(kept.iterdir(), key=lambda each: each.stat().st_mtime)[:-_KEPT]:
        shutil.rmtree(old, ignore_errors=True)
    return replace(found, seconds=time.monotonic() - started if made else 0.0)


def _write(layout: Layout, folder: Path) -> None:
    """Writes a folder, whole or not at all."""
    part = folder.with_suffix(".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    write_maps(layout, part)
    _keep(layout, part)
    part.rename(folder)


def _write_mask(layout: Layout, shades: Array | None, path: Path) -> None:
    """Writes a mask in the place of those before it."""
    _replace(_MASK, path, with_margin(layout.raster, drawn(layout, shades)))


def _write_light(layout: Layout, light: Light, frame: int, path: Path) -> None:
    """Writes what light falls on it, likewise."""
    seen, size = layout.seen, shrunk(layout.raster.size)
    _replace(_LIGHT, path, light_on(light, seen.parts, seen.around, layout.uv, size, frame))


def _replace(kind: str, path: Path, pixels: Array) -> None:
    """Writes a map in the place of those of its kind."""
    for old in path.parent.glob(f"{kind}*"):
        old.unlink()
    part = path.with_name("part.exr")
    write_exr(part, pixels)
    part.rename(path)


def own_uv_map(
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    frame: int,
    *,
    uv_map: str | None,
    tiles: Tiles,
    alike: bool = False,
) -> UVMap | None:
    """The UV map that `write_surface` lays maps out in where it makes one, and no maps."""
    seen, name = collect(material, scene, frame, uv_map=uv_map or ""), free_name(material)
    layout = lay_out(
        *(seen, material, scene, frame),
        uv_map=uv_map,
        tiles=tiles,
        alike=alike,
        name=name,
        size=_SIZE,
    )
    return layout.own if isinstance(layout, Layout) else None


def _keep(layout: Layout, folder: Path) -> None:
    """Writes what is to be known of a layout the next time."""
    own = layout.own
    if own is not None:
        np.savez(folder / _PLACES, **{str(uid): places for uid, places in own.places.items()})
    said = {"notes": layout.notes, "own": own and own.name}
    (folder / _LAYOUT).write_text(json.dumps(said), encoding="utf-8")


def _kept(folder: Path) -> SurfaceMaps:
    said = json.loads((folder / _LAYOUT).read_text(encoding="utf-8"))
    own = None
    if said["own"] is not None:
        with np.load(folder / _PLACES) as places:
            own = UVMap(said["own"], {int(uid): places[uid] for uid in places.files})
    return SurfaceMaps(folder, own, tuple(said["notes"]))


def _digest(seen: Seen, settings: str) -> str:
    """Of all that the maps are made from."""
    digest = hashlib.blake2b(_VERSION + settings.encode(), digest_size=16)
    for each in (each for shown in seen.shown for each in shown.bytes()):
        digest.update(each)
    for around in seen.around:
        digest.update(around.vertices.tobytes())
        digest.update(around.triangles.tobytes())
        digest.update(np.array(around.matrices, np.float64).tobytes())
    return digest.hexdigest()
