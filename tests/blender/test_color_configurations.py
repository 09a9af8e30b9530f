"""Whatever color configuration Blender runs with, aged textures are the numbers in their files."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import sys
from pathlib import Path
import bpy
import tests.conftest, tvbrdf
from tests.blender.material_cases import (
    made_up, new_material, plane, principled_of, procedural, render, view_from_above
)
from tests.blender.aged_cases import bind
from tests.blender.aged_cases import emitting

bpy.ops.wm.read_factory_settings(use_empty=True)
tvbrdf.register()
folder = Path(sys.argv[1])
material = new_material()
procedural(material)
view_from_above()
names = {each.identifier for each in
         bpy.types.ColorManagedInputColorspaceSettings.bl_rna.properties["name"].enum_items}
print("Non-Color is known:", "Non-Color" in names)
bind(material, plane(material), made_up(folder / "aged"), folder)
images = [node.image for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
assert len(images) == 8 and all(each.colorspace_settings.is_data for each in images)
uniform = new_material("Uniform")
uniform.tvbrdf.onset = "none"
plane(uniform).location.x = 9
bind(uniform, None, made_up(folder / "uniform", size=1), folder)
bpy.context.scene.frame_set(4)
print("uniform", round(principled_of(uniform).inputs["Roughness"].default_value, 3))
emitting(material)
shown = render(folder / "r.exr", 4, size=4, samples=1)[1, 1]
print("texture", *(round(float(v), 3) for v in shown))
tvbrdf.unregister()
"""


@pytest.mark.parametrize(
    ("configuration", "known"),
    [
        ("", True),
        ("ocio://cg-config-v2.1.0_aces-v1.3_ocio-v2.3", False),
        ("ocio://studio-config-v2.1.0_aces-v1.3_ocio-v2.3", False),
    ],
)
def test_the_numbers_are_those_of_the_files(tmp_path: Path, configuration: str, known: bool):
    surroundings = {key: value for key, value in os.environ.items() if key != "OCIO"}
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path)],
        cwd=ROOT,
        env=surroundings | ({"OCIO": configuration} if configuration else {}),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert f"Non-Color is known: {known}" in run.stdout, "a name would do: this shows nothing"
    assert "uniform 0.5" in run.stdout
    assert "texture 0.5 0.5 0.5" in run.stdout
