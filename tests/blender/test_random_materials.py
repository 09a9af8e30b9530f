"""Random files age, are saved, opened and saved without the extension, and come back exactly.

`TVBRDF_RANDOM_MATERIALS=100` tries a hundred of them instead of a handful, `TVBRDF_RANDOM_SEED=7`
begins with the seventh.
"""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import numpy as np
import pytest

import tvbrdf
from tests.blender.material_cases import render, snapshot, view_from_above
from tests.blender.random_materials import build

pytestmark = pytest.mark.usefixtures("stub_worker")
COUNT = int(os.environ.get("TVBRDF_RANDOM_MATERIALS", "6"))
FIRST = int(os.environ.get("TVBRDF_RANDOM_SEED", "0"))
LAST_FRAME = 9


def everything() -> dict[str, object]:
    """All materials of the file and all that they share, at its first frame."""
    bpy.context.scene.frame_set(1)
    return {material.name: snapshot(material) for material in bpy.data.materials}


@pytest.mark.parametrize("seed", range(FIRST, FIRST + COUNT))
def test_it_ages_travels_and_comes_back(empty_scene, tmp_path: Path, seed: int):
    material = build(seed)
    name, settings = material.name, material.tvbrdf
    settings.steps, settings.size = 3, 16
    settings.onset = ("none", "auto")[seed % 2]
    settings.format = ("as-authored", "exact")[seed % 3 == 0]
    view_from_above()
    empty_scene.frame_start, empty_scene.frame_end = 1, LAST_FRAME
    file = tmp_path / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    before = everything()
    assert bpy.ops.tvbrdf.age_material(material=name) == {"FINISHED"}
    if seed % 2:
        assert bpy.ops.tvbrdf.age_material(material=name) == {"FINISHED"}
    if seed % 3 == 1:
        empty_scene.frame_set(4)
        assert bpy.ops.tvbrdf.freeze(material=name) == {"FINISHED"}
    aged = everything()
    assert aged != before
    for other in before:
        if other != name:
            for key in ("material", "nodes", "links"):
                assert aged[other][key] == before[other][key], f"{other}: {key}"
    bpy.ops.wm.save_mainfile()

    tvbrdf.unregister()
    try:
        bpy.ops.wm.open_mainfile(filepath=str(file))
        assert not hasattr(bpy.types.Material, "tvbrdf")
        lost = [path for path in bpy.utils.blend_paths(absolute=True) if not Path(path).is_file()]
        assert not lost
        for frame in (1, 4, LAST_FRAME):
            picture = render(tmp_path / "picture.exr", frame, size=4, samples=1)
            assert np.isfinite(picture).all()
        bpy.data.images.remove(bpy.data.images["Render Result"])
        bpy.ops.wm.save_mainfile()
    finally:
        tvbrdf.register()

    bpy.ops.wm.open_mainfile(filepath=str(file))
    assert bpy.ops.tvbrdf.revert(material=name) == {"FINISHED"}
    after = everything()
    for each in before:
        for key in before[each]:
            assert after[each][key] == before[each][key], f"{each}: {key}"
