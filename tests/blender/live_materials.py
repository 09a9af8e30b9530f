"""Live materials: bound to a result that is made up, and looked at."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from tests.blender.aged_cases import bind
from tests.blender.live_cases import made_up_live
from tests.blender.material_cases import add, new_material, plane, principled_of, procedural, render


def aged(tmp_path: Path, build=procedural, kind="principled", span=(1, 11), **options):
    """A material that a live result ages, on a plane."""
    material = new_material()
    build(material)
    obj = plane(material)
    folder = made_up_live(tmp_path / f"live {kind}", kind, **options)
    bind(material, obj, folder, tmp_path, span=span)
    return material, obj


def group_node(material) -> bpy.types.Node:
    return next(node for node in material.node_tree.nodes if node.type == "GROUP")


def emitting(material, output: str = "Base Color") -> None:
    """Shows an output of the group as light."""
    tree = material.node_tree
    emission = add(material, "ShaderNodeEmission")
    tree.links.new(group_node(material).outputs[output], emission.inputs[0])
    tree.links.new(emission.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])


def shown(tmp_path: Path, frame: int = 1, size: int = 8) -> np.ndarray:
    return render(tmp_path / "shown.exr", frame, size=size, samples=1)


def flat(material) -> None:
    principled_of(material).inputs["Base Color"].default_value = (0.9, 0.9, 0.9, 1)


def data_blocks() -> dict[str, list[str]]:
    kinds = ("actions", "images", "node_groups")
    return {kind: sorted(each.name for each in getattr(bpy.data, kind)) for kind in kinds}
