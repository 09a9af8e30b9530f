"""Revert: the material is again exactly what the artist made, by a walk over its properties."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import bpy
import pytest

from tests.blender.aged_cases import FORMATS, bind, settled
from tests.blender.material_cases import (
    add,
    awkward,
    link,
    made_up,
    new_material,
    plane,
    principled_of,
    procedural,
)

pytestmark = pytest.mark.usefixtures("empty_scene")
ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("build", [procedural, awkward])
def test_revert_restores_everything(tmp_path, kind, build):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged, revert

    material = new_material()
    build(material)
    obj = plane(material)
    before = settled(material)
    bind(material, obj, made_up(tmp_path / "aged", kind), tmp_path)
    assert is_aged(material)
    assert settled(material) != before
    revert(material)
    assert not is_aged(material)
    after = settled(material)
    for key in before:
        assert after[key] == before[key], key


@pytest.mark.parametrize("size", [1, 4])
@pytest.mark.parametrize("kind", FORMATS)
def test_uniform_and_textured_constants_revert(tmp_path, kind, size):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    inputs = principled_of(material).inputs
    inputs["Base Color"].default_value = (0.1, 0.7, 1 / 3, 0.25)
    inputs["Roughness"].default_value = 0.123456
    inputs["Metallic"].default_value = 0.5
    inputs["Metallic"].keyframe_insert("default_value", frame=1)
    obj = plane(material)
    before = settled(material)
    bind(material, obj, made_up(tmp_path / "aged", kind, size=size), tmp_path)
    bpy.context.scene.frame_set(7)
    revert(material)
    assert settled(material) == before


def test_what_the_artist_changes_after_aging_stays(tmp_path):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    procedural(material)
    bind(material, plane(material), made_up(tmp_path / "aged"), tmp_path)
    added = add(material, "ShaderNodeTexVoronoi")
    link(material, added.outputs["Color"], "Emission Color")
    principled_of(material).inputs["IOR"].default_value = 2.0
    revert(material)
    inputs = principled_of(material).inputs
    assert inputs["Emission Color"].links[0].from_node == added
    assert inputs["IOR"].default_value == 2.0
    assert inputs["Base Color"].links[0].from_node.type == "VALTORGB"


def test_a_deleted_node_does_not_stop_revert(tmp_path):
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    procedural(material)
    bind(material, plane(material), made_up(tmp_path / "aged"), tmp_path)
    tree = material.node_tree
    tree.nodes.remove(next(n for n in tree.nodes if n.type == "VALTORGB"))
    revert(material)
    inputs = principled_of(material).inputs
    assert not inputs["Base Color"].is_linked
    assert inputs["Roughness"].links[0].from_node.type == "TEX_NOISE"


def test_a_damaged_record_is_refused_with_a_sentence(tmp_path):
    from tvbrdf.tvbrdf_addon.errors import MaterialError
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    for damaged in ('{"version": 99}', "nonsense", '{"version": 1}'):
        material.tvbrdf.original = damaged
        with pytest.raises(MaterialError, match="before aging"):
            revert(material)


def test_revert_after_reload_in_another_process(tmp_path):
    """Ages and saves here; a second Blender reverts and compares with what was seen here."""
    import json

    material = new_material()
    awkward(material)
    obj = plane(material)
    before = settled(material)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bind(material, obj, made_up(tmp_path / "aged"), tmp_path)
    bpy.ops.wm.save_mainfile()
    (tmp_path / "before.json").write_text(json.dumps(before))
    script = (
        "import json, sys, bpy\n"
        "from pathlib import Path\n"
        "import tests.conftest, tvbrdf\n"
        "from tests.blender.material_cases import snapshot\n"
        "from tvbrdf.tvbrdf_addon.material.nodes.revert import revert\n"
        "tvbrdf.register()\n"
        "folder = Path(sys.argv[1])\n"
        "bpy.ops.wm.open_mainfile(filepath=str(folder / 'scene.blend'))\n"
        "material = bpy.data.materials['Paint']\n"
        "revert(material)\n"
        "bpy.context.scene.frame_set(1)\n"
        "before = json.loads((folder / 'before.json').read_text())\n"
        "after = json.loads(json.dumps(snapshot(material)))\n"
        "wrong = [key for key in before if before[key] != after[key]]\n"
        "assert not wrong, [(before[key], after[key]) for key in wrong]\n"
        "print('equal')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert "equal" in done.stdout, done.stdout[-3000:] + done.stderr[-3000:]
