"""Materials read, aged by a result that is made up, and looked at: what most tests begin with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from tests.blender.material_cases import add, principled_of, snapshot

FORMATS = ("principled", "principled-exact", "torrance-sparrow")


def read(material, obj, tmp_path: Path):
    from tvbrdf.tvbrdf_addon.material.reading.read import read as read_material

    folder = tmp_path / "maps"
    folder.mkdir(exist_ok=True)
    return read_material(
        material=material, obj=obj, scene=bpy.context.scene, folder=folder, size=16
    )


def refusal(material, obj, tmp_path: Path) -> str:
    from tvbrdf.tvbrdf_addon.errors import MaterialError

    with pytest.raises(MaterialError) as caught:
        read(material, obj, tmp_path)
    return str(caught.value)


def bind(material, obj, folder: Path, tmp_path: Path, span=(1, 10)):
    from tvbrdf.tvbrdf_addon.material.binding.bind import bind as bind_material

    return bind_material(
        material=material,
        reading=read(material, obj, tmp_path),
        folder=folder,
        frame_start=span[0],
        frame_end=span[1],
    )


def emitting(material) -> None:
    """Shows Base Color as light, so that a render gives its value."""
    tree = material.node_tree
    emission = add(material, "ShaderNodeEmission")
    tree.links.new(principled_of(material).inputs[0].links[0].from_socket, emission.inputs[0])
    tree.links.new(emission.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])


def settled(material) -> dict[str, object]:
    """The snapshot once Blender has evaluated keys and drivers."""
    bpy.context.scene.frame_set(1)
    return snapshot(material)


def sentence(operate: Callable[[], object]) -> str:
    """What `operate` says, which must change nothing; empty where it does what it is to do."""
    from tvbrdf.tvbrdf_addon.errors import MaterialError

    before = [snapshot(material) for material in bpy.data.materials]
    said = ""
    try:
        operate()
    except MaterialError as error:
        said = str(error)
    if said:
        assert said[-1] == "."
        assert [snapshot(material) for material in bpy.data.materials] == before
    return said
