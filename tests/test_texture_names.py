"""Which file is which map, by its name alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from model_runtime.reading.texture_names import choose_maps


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("Wood049_1K-JPG_Color.jpg", "base_color"),
        ("T_Rock_BaseColor.tif", "base_color"),
        ("WoodFloor_Base_Color.png", "base_color"),
        ("rusty metal-basecolor-1024.png", "base_color"),
        ("BASECOLOR.PNG", "base_color"),
        ("stoneCol_4K.jpg", "base_color"),
        ("albedo.jpeg", "base_color"),
        ("wood_diff_2k.png", "base_color"),
        ("DiffuseColor.png", "base_color"),
        ("rough_wood_diff_1k.jpg", "base_color"),
        ("Metal_01_Color.png", "base_color"),
        ("Metal_Roughness.jpg", "roughness"),
        ("rough_wood_rough_1k.jpg", "roughness"),
        ("oak_rgh.jpg", "roughness"),
        ("oak_roughness_map.png", "roughness"),
        ("oakGloss.jpg", "gloss"),
        ("oak_Glossiness.exr", "gloss"),
        ("PaintedMetal004_1K-JPG_Metalness.jpg", "metallic"),
        ("Metal_COL_2K_METALLIC.jpg", "metallic"),
        ("plate_mtl.png", "metallic"),
        ("METAL.png", "metallic"),
        ("bricks_spec.png", "specular"),
        ("Specular IOR Level.exr", "specular"),
        ("IOR.exr", "ior"),
        ("wood_arm_2k.jpg", "packed"),
        ("T_Crate_ORM.png", "packed"),
        ("crate_OcclusionRoughnessMetallic.png", "packed"),
        ("SpecularTint.exr", "specular_tint"),
        ("x_specular_tint.png", "specular_tint"),
    ],
)
def test_names_as_artists_write_them(name: str, found: str) -> None:
    names = [name] if found == "base_color" else [name, "only_albedo.png"]
    assert choose_maps(Path("folder"), names)[found] == name


@pytest.mark.parametrize(
    "name",
    [
        "Wood049_1K-JPG_NormalGL.jpg",
        "wood_nor_gl_2k.jpg",
        "wood_Displacement.exr",
        "wood_height.png",
        "wood_AO.jpg",
        "wood_Ambient_Occlusion.jpg",
        "wood_opacity.png",
        "wood_Emission_Color.png",
        "wood_SpecularColor.png",
        "wood_coat_roughness.png",
        "wood_color_preview.png",
        "Metal035.png",
        "rough_wood.png",
        "notes_color.txt",
        "wood_color.blend",
        ".hidden_color.png",
    ],
)
def test_other_files_are_no_maps(name: str) -> None:
    assert choose_maps(Path("folder"), ["wood_albedo.jpg", name]) == {
        "base_color": "wood_albedo.jpg"
    }


def test_of_duplicates_one_is_chosen_whatever_the_order() -> None:
    names = ["a_2K_Color.png", "a_1K_Color.jpg", "a_2K_Color.jpg", "a_2K_Diffuse.jpg"]
    names += ["a_gloss.jpg", "a_roughness.exr"]
    for ordered in (names, names[::-1], sorted(names)):
        assert choose_maps(Path("folder"), ordered) == {
            "base_color": "a_2K_Color.jpg",
            "roughness": "a_roughness.exr",
        }
