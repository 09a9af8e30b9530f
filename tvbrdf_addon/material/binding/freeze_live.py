"""Keeps a live material as old as it is on one frame: as stills, which any program can read."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np

from ....model_runtime.brdf import principled
from ....model_runtime.contract import HEIGHT
from ....model_runtime.live.evaluate import LiveMaps
from ....model_runtime.maps import PrincipledMaps
from ....model_runtime.resampling import resize
from ...errors import MaterialError
from ...output import free_folder
from ..nodes.age import age_at
from ..nodes.record import load, require_local
from ..nodes.strengths import GRAIN, strength
from ..reading.onset import showing
from ..reading.pixels import Array, read_data, read_exr, write_exr
from ..reading.read import read
from ..result import AgedMap, AgedMaps, LiveFiles, read_result, result_folder
from .bind import bind_stills
from .freeze import freeze
from .live import read_curves, read_lobes

__all__ = ("freeze_live",)


def freeze_live(
    material: bpy.types.Material, obj: bpy.types.Object | None, scene: bpy.types.Scene
) -> tuple[str, ...]:
    """Leaves `material`, which `obj` shows, as it looks on the scene's frame; Revert still restores
    the original.  Returns warnings, a sentence each.

    The stills are new files in a folder of their own beside the result's; where its timing has a
    UV map of its own there are none, and Age holds still.  Raises `MaterialError`,
    with the material as it is, where it cannot be read or its result is gone.
    """
    require_local(material)
    settings, record = material.tvbrdf, load(material, material.name)
    if record.uv_map is not None:
        freeze(material, scene.frame_current)
        return (
            f"“{material.name}” keeps its nodes, with Age as it is: its places age apart from its "
            "textures, so that one set of these cannot show them.",
        )
    folder = result_folder(material)
    if folder is None:
        raise MaterialError(f"“{material.name}” has no result.", "Age the material again.")
    files = read_result(folder)
    if not isinstance(files, LiveFiles) or record.age is None:
        raise MaterialError(f"The result in {folder} is another one.", "Age the material again.")
    age = age_at(material, record.age, scene.frame_current)
    with tempfile.TemporaryDirectory(prefix="tvbrdf-") as place:
        reading = read(
            material=material,
            obj=obj,
            scene=scene,
            folder=Path(place),
            size=None if settings.use_camera_size else settings.size,
            frame=scene.frame_current,
        )
        authored = _authored(Path(place), files.size)
    evaluator = _evaluator(files, strength(material, GRAIN) or 0.0)
    stills = principled.in_format(evaluator.aged(authored, age), files.format, authored)
    stills |= evaluator.further(age)
    if files.height:
        stills[HEIGHT] = evaluator.height(age)
    taken = [Path(bpy.path.abspath(image.filepath)).parent for image in bpy.data.images]
    home = free_folder(folder, f"frame {scene.frame_current}", taken)
    home.mkdir(exist_ok=True)
    for name, pixels in stills.items():
        write_exr(home / f"{name}.exr", pixels)
    maps = {name: AgedMap(name, (home / f"{name}.exr",), (0,), uniform=False) for name in stills}
    height = maps.pop(HEIGHT, None)
    bind_stills(
        material, reading, AgedMaps(files.format, (), tuple(maps.values()), files.unit, height)
    )
    return _other_ages(material, record.age)


def _other_ages(material: bpy.types.Material, age: str) -> tuple[str, ...]:
    """Which objects had another age than the material, whose one set of stills they now show."""
    names = [f"“{each.name}”" for each in showing(material) if age in each]
    if not names:
        return ()
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return (
        f"The {age} that {names[0]}{more} had of its own is not kept: to keep it, undo this and "
        "give each a material of its own first.",
    )


def _authored(folder: Path, size: tuple[int, int]) -> PrincipledMaps:
    """The maps that were read into `folder`, at the size of the result."""

    def color(name: str) -> Array:
        return resize(read_exr(folder / f"{name}.exr"), size)

    def number(name: str) -> Array:
        return np.ascontiguousarray(color(name)[..., 0])

    return PrincipledMaps(
        base_color=color("BaseColor"),
        metallic=number("Metallic"),
        specular=number("Specular"),
        roughness=number("Roughness"),
        ior=number("IOR"),
        specular_tint=color("SpecularTint"),
    )


def _evaluator(files: LiveFiles, grain: float) -> LiveMaps:
    curves = read_curves(files.curves)
    images = [read_data(path) for path in files.coefficients]
    coefficients = files.packing.unpacked(images, files.size, len(curves.shapes), files.grain)
    coefficients[..., len(curves.shapes) - files.grain :] *= grain
    return LiveMaps(
        curves=curves,
        timing=None if files.timing is None else read_exr(files.timing),
        coefficients=coefficients,
        lobes=read_lobes(files),
    )
