"""The right model comes first, for materials and expectations of `suited_cases.py`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest

from model_runtime.maps import PrincipledMaps, TorranceSparrowMaps
from model_runtime.model_files import weights
from model_runtime.model_files.suits import DOUBTFUL, PURPOSES, Surface, ordered, substances
from tests.blender.material_cases import add, link, new_material, plane, principled_of, textured
from tests.blender.suited_cases import CALLED, MEASURED, TEXTURED
from tvbrdf.tvbrdf_addon import suiting
from tvbrdf.tvbrdf_addon.material.reading.appearance import surface_of

pytestmark = pytest.mark.usefixtures("empty_scene")

CARDS = weights.list_models([weights.MODELS])
SHARE = 0.9
"""Of the materials, those that are to get a right model first."""


def of_textures(folder: Path) -> bpy.types.Material:
    """What an artist makes of a texture set: named after it, an image for each of three sockets."""
    material = new_material(folder.name)
    packed = next(folder.glob("*_arm_*"), None)
    for socket, tags in {
        "Base Color": ("*_Color.*", "*_diff_*"),
        "Roughness": ("*_Roughness.*", "*_rough_*"),
        "Metallic": ("*_Metalness.*",),
    }.items():
        found = next((path for tag in tags for path in folder.glob(tag)), packed)
        if found is None:
            continue
        node = add(material, "ShaderNodeTexImage", image=bpy.data.images.load(str(found)))
        output = node.outputs["Color"]
        if socket != "Base Color":
            node.image.colorspace_settings.name = "Non-Color"
        if found == packed:
            parts = add(material, "ShaderNodeSeparateColor")
            material.node_tree.links.new(output, parts.inputs[0])
            output = parts.outputs["Green" if socket == "Roughness" else "Blue"]
        link(material, output, socket)
    return material


def of_measurements(data: Path) -> Iterator[tuple[bpy.types.Material, set[str]]]:
    """Measured BRDFs as the values of a Principled BSDF, with the models that are right."""
    import torch

    from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
    from model_runtime.brdf.principled import read_back
    from training.data.nbrdf import load

    for database, expected in MEASURED.items():
        networks = load(data, database).select(list(expected))
        fit = fit_torrance_sparrow(networks.evaluate(torch.arange(len(networks)), fit_angles()))
        kd, ks, alpha = (each.float().numpy()[None] for each in (fit.kd, fit.ks, fit.alpha))
        one = np.ones((1, len(expected)), np.float32)
        gray = PrincipledMaps(
            np.full_like(kd, 0.5), 0 * one, 0.5 * one, 0.5 * one, 1.5 * one, np.ones_like(kd)
        )
        values = read_back(TorranceSparrowMaps(kd, ks, alpha), gray)
        for number, (name, right) in enumerate(expected.items()):
            material = new_material(name)
            inputs = principled_of(material).inputs
            inputs["Base Color"].default_value = (*values.base_color[0, number], 1)
            inputs["Metallic"].default_value = values.metallic[0, number]
            inputs["Roughness"].default_value = values.roughness[0, number]
            yield material, right


def first(surface: Surface) -> str:
    return ordered(CARDS, surface)[0].name


def report(what: str, wrong: dict[str, str], count: int) -> None:
    print(f"{what}: {count - len(wrong)} of {count} right first; not {wrong}")


@pytest.mark.slow
def test_forty_materials_get_a_right_model_first(data_folder: Path):
    cases = [(of_textures(data_folder / name), right) for name, right in TEXTURED.items()]
    cases += of_measurements(data_folder)
    surfaces = [(surface_of(material), right) for material, right in cases]
    assert len(surfaces) == 40
    wrong = {each.names[0]: first(each) for each, right in surfaces if first(each) not in right}
    report("Named as they are", wrong, 40)
    nameless = [
        (Surface(each.color, each.metallic, each.roughness, each.textured, each.fibers), each.names)
        for each, _ in surfaces
    ]
    lost = {
        names[0]: first(each)
        for (each, names), (_, right) in zip(nameless, surfaces, strict=True)
        if first(each) not in right
    }
    report("By their looks alone", lost, 40)
    assert len(wrong) <= 40 * (1 - SHARE)


def test_names_of_artists_libraries_are_understood():
    called = [(name, right) for right, names in CALLED for name in names]
    wrong = {}
    for name, right in called:
        best = first(Surface((0.3, 0.3, 0.3), roughness=0.6, names=(name,)))
        if best not in right:
            wrong[name] = best
    report("By their names alone", wrong, len(called))
    assert len(wrong) <= len(called) * (1 - SHARE)


def test_copper_gets_patina_and_rust_is_doubted():
    copper = Surface((0.95, 0.45, 0.25), metallic=1, roughness=0.3)
    best, *others = ordered(CARDS, copper)
    assert (best.name, best.doubt) == ("patina", "")
    (rust,) = (each for each in others if each.name == "rust")
    assert rust.doubt == (
        "Rust is for bare or painted steel; this looks like copper. Patina suits it better."
    )


def test_what_no_model_is_for_is_doubted_with_every_model():
    gold = ordered(CARDS, Surface((1, 0.8, 0.3), metallic=1, roughness=0.2, names=("Gold Ring",)))
    assert all(each.score < DOUBTFUL and each.doubt for each in gold)
    assert not any("suits it better" in each.doubt for each in gold)


def test_every_bundled_model_has_a_purpose_that_fits_a_line():
    assert {card.process for card in CARDS} == set(PURPOSES)
    assert all(len(purpose.told) < 40 for purpose in PURPOSES.values())


def test_what_it_is_made_of_sums_to_one():
    assert sum(substances(Surface((0.2, 0.1, 0.05))).values()) == pytest.approx(1)


def test_what_images_say_of_a_material_is_seen():
    material = new_material()
    stripes = np.full((128, 128, 3), 0.5, np.float32)
    stripes[:, ::8] = 0.1
    textured(material, stripes * (0.5, 0.3, 0.2))
    surface = surface_of(material)
    assert surface.textured and surface.fibers > 2
    assert surface.color == pytest.approx(stripes.mean() * np.array((0.5, 0.3, 0.2)), rel=0.02)


class TestInTheList:
    """What the panel does once a timer has looked at the material."""

    @pytest.fixture
    def copper(self) -> bpy.types.Material:
        material = new_material("Material")
        plane(material)
        inputs = principled_of(material).inputs
        inputs["Base Color"].default_value = (0.95, 0.45, 0.25, 1)
        inputs["Metallic"].default_value = 1
        return material

    def test_the_best_is_chosen_at_first_and_listed_first(self, copper):
        assert suiting.look_at(copper)
        assert copper.tvbrdf.ntm == "patina"
        assert suiting.models_for(copper)[0][0] == "patina"
        assert suiting.models_for(copper)[-1][0] == "file"
        assert suiting.doubt(copper) == ""
        assert not suiting.look_at(copper), "nothing new"

    def test_it_follows_the_material(self, copper):
        suiting.look_at(copper)
        principled_of(copper).inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1)
        assert suiting.look_at(copper)
        assert copper.tvbrdf.ntm == "rust"

    @pytest.mark.parametrize("chosen", ["moss", "patina"])
    def test_but_never_overrules_who_has_chosen(self, copper, chosen):
        suiting.look_at(copper)
        copper.tvbrdf.ntm = chosen
        principled_of(copper).inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1)
        suiting.look_at(copper)
        assert copper.tvbrdf.ntm == chosen
        assert "this looks like steel. Rust suits it better." in suiting.doubt(copper)
