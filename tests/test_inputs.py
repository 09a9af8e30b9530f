"""What `--input` accepts, by name and by content, and the sentences with which it refuses."""

from __future__ import annotations

import hashlib
import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model_runtime.brdf.measured import MeasuredBRDF
from model_runtime.errors import InputError, UsageError
from model_runtime.images import read_image, write_exr
from model_runtime.maps import PrincipledMaps, TorranceSparrowMaps
from model_runtime.reading.inputs import hash_input, read_input
from tests.aging import run


def save(
    path: Path, code: int | tuple[int, int, int] = 128, size: tuple[int, int] = (8, 8)
) -> Path:
    Image.new("RGB" if isinstance(code, tuple) else "L", (size[1], size[0]), code).save(path)
    return path


def write_maps(folder: Path, **maps: object) -> Path:
    for name, pixels in maps.items():
        write_exr(folder / f"{name}.exr", np.asarray(pixels, np.float32))
    return folder


def read_principled(path: Path, *, size: int | None = None) -> PrincipledMaps:
    maps = read_input(path, size=size)
    assert isinstance(maps, PrincipledMaps)
    return maps


def refused(path: Path, sentence: str) -> InputError:
    with pytest.raises(InputError, match=sentence) as caught:
        read_input(path)
    assert caught.value.message.endswith(".")
    assert caught.value.hint.endswith(".")
    return caught.value


def test_two_materials_in_a_folder_are_named(tmp_path: Path) -> None:
    save(tmp_path / "Oak_Color.png")
    save(tmp_path / "Pine_Color.png")
    error = refused(tmp_path, "several materials")
    assert "'oak'" in error.message
    assert "'pine'" in error.message


def test_a_map_of_another_name_serves_where_it_is_the_only_one(tmp_path: Path) -> None:
    save(tmp_path / "Oak_Color.png")
    save(tmp_path / "scratches_Roughness.png", 0)
    assert read_principled(tmp_path).roughness.max() == 0
    save(tmp_path / "dents_Roughness.png", 255)
    refused(tmp_path, "'dents' and 'scratches', and none of 'oak'")
    save(tmp_path / "Oak_Roughness.png", 51)
    np.testing.assert_allclose(read_principled(tmp_path).roughness, 0.2)


def test_ambientcg_material_is_read(data_folder: Path) -> None:
    folder = data_folder / "pbr" / "PaintedMetal004"
    maps = read_principled(folder)
    assert maps.size == (1024, 1024)
    np.testing.assert_array_equal(
        maps.roughness, read_image(folder / "PaintedMetal004_1K-JPG_Roughness.jpg", color=False)
    )
    assert 0.01 < maps.metallic.mean() < 0.5, "red paint scratched to bare metal"
    assert maps.base_color[..., 0].mean() > 2 * maps.base_color[..., 2].mean()
    assert (maps.specular == 0.5).all()
    assert (maps.ior == 1.5).all()
    assert (maps.specular_tint == 1).all()
    assert set(hash_input(folder)) == {
        f"PaintedMetal004_1K-JPG_{name}.jpg" for name in ("Color", "Metalness", "Roughness")
    }


def test_every_material_of_the_data_is_read_small(data_folder: Path) -> None:
    folders = [folder for folder in sorted((data_folder / "pbr").iterdir()) if folder.is_dir()]
    assert len(folders) == 12
    for folder in folders:
        maps = read_principled(folder, size=64)
        assert maps.size == (64, 64)
        metal = any("Metalness" in file.name for file in folder.iterdir())
        assert metal == bool(maps.metallic.any())


def test_missing_maps_have_the_defaults_of_blender(tmp_path: Path) -> None:
    save(tmp_path / "color.png", (255, 0, 188))
    maps = read_principled(tmp_path)
    np.testing.assert_allclose(maps.base_color[0, 0], [1, 0, 0.50289], rtol=1e-4)
    assert (maps.metallic == 0).all()
    assert (maps.specular == 0.5).all()
    assert (maps.roughness == 0.5).all()
    assert (maps.ior == 1.5).all()
    assert (maps.specular_tint == 1).all()


def test_gloss_is_inverted(tmp_path: Path) -> None:
    save(tmp_path / "wood_diffuse.png")
    save(tmp_path / "wood_gloss.png", 51)
    np.testing.assert_allclose(read_principled(tmp_path).roughness, 0.8)


def test_maps_of_the_add_on_are_taken_as_they_are(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    base, metallic = rng.random((4, 6, 3)) * 0.9, rng.random((4, 6))
    write_maps(
        tmp_path,
        BaseColor=base,
        Metallic=metallic,
        Roughness=[[0.25]],
        Specular=[[0.75]],
        IOR=[[1.25]],
        SpecularTint=[[[1.0, 0.5, 0.25]]],
    )
    maps = read_principled(tmp_path)
    assert maps.size == (4, 6)
    np.testing.assert_array_equal(maps.base_color, base.astype(np.float16))
    np.testing.assert_array_equal(maps.metallic, metallic.astype(np.float16))
    assert (maps.roughness == 0.25).all()
    assert (maps.specular == 0.75).all()
    assert (maps.ior == 1.25).all()
    assert (maps.specular_tint == np.array([1, 0.5, 0.25], np.float32)).all()


def test_constants_alone_are_a_uniform_material_of_any_size(tmp_path: Path) -> None:
    write_maps(tmp_path, BaseColor=[[[0.5, 0.25, 0.125]]], Roughness=[[0.25]])
    for size in (None, 256):
        maps = read_principled(tmp_path, size=size)
        assert maps.uniform
        assert maps.base_color.tolist() == [[[0.5, 0.25, 0.125]]]
        assert maps.metallic.shape == (1, 1)


def test_torrance_sparrow_folder(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    kd, ks, alpha = rng.random((5, 3, 3)), rng.random((5, 3, 3)), rng.random((5, 3))
    write_maps(tmp_path, kd=kd, ks=ks, alpha=alpha)
    save(tmp_path / "preview_color.png")
    maps = read_input(tmp_path)
    assert isinstance(maps, TorranceSparrowMaps)
    np.testing.assert_array_equal(maps.kd, kd.astype(np.float16))
    np.testing.assert_array_equal(maps.ks, ks.astype(np.float16))
    np.testing.assert_array_equal(maps.alpha, alpha.astype(np.float16))
    assert set(hash_input(tmp_path)) == {"kd.exr", "ks.exr", "alpha.exr"}
    (tmp_path / "alpha.exr").unlink()
    refused(tmp_path, r"lacks alpha\.exr")
    (tmp_path / "ks.exr").unlink()
    refused(tmp_path, r"lacks ks\.exr and alpha\.exr")


def test_measured_material(data_folder: Path) -> None:
    path = data_folder / "bsdf" / "ilm_l3_37_matte_rgb.bsdf"
    brdf = read_input(path)
    assert isinstance(brdf, MeasuredBRDF)
    assert brdf.name == "ilm_l3_37_matte_rgb"
    assert hash_input(path) == {path.name: hashlib.sha256(path.read_bytes()).hexdigest()}


def test_smaller_maps_are_brought_to_the_largest(tmp_path: Path) -> None:
    save(tmp_path / "x_color.png", size=(16, 32))
    Image.fromarray(np.array([[0, 255]], np.uint8)).save(tmp_path / "x_roughness.png")
    maps = read_principled(tmp_path)
    assert maps.roughness.shape == (16, 32)
    assert maps.roughness[0, 7:9].max() < 0.05
    assert maps.roughness[0, 23:25].min() > 0.95
    assert maps.roughness[0, [0, -1]] == pytest.approx([15 / 32, 17 / 32])  # it repeats


@pytest.mark.parametrize(
    ("size", "shape"), [(16, (8, 16)), (64, (32, 64)), (1, (1, 1)), (None, (16, 32))]
)
def test_size_is_the_longer_side(tmp_path: Path, size: int | None, shape: tuple[int, int]) -> None:
    save(tmp_path / "x_color.png", size=(16, 32))
    save(tmp_path / "x_roughness.png", size=(8, 16))
    assert read_principled(tmp_path, size=size).size == shape


@pytest.mark.parametrize("size", [0, -5, 16385])
def test_impossible_sizes_are_usage_errors(tmp_path: Path, size: int) -> None:
    save(tmp_path / "x_color.png")
    with pytest.raises(UsageError, match=str(size)):
        read_input(tmp_path, size=size)


def test_maps_of_different_shapes_are_refused(tmp_path: Path) -> None:
    save(tmp_path / "x_color.png", size=(16, 32))
    save(tmp_path / "x_roughness.png", size=(32, 32))
    refused(tmp_path, r"x_color\.png has 32 x 16 pixels and x_roughness\.png 32 x 32")


@pytest.mark.parametrize(
    ("value", "what"),
    [
        (np.nan, "NaN or infinite"),
        (np.inf, "NaN or infinite"),
        (-0.25, "negative"),
        (1e30, "above 65,504"),
    ],
)
def test_texels_that_cannot_be_are_counted(tmp_path: Path, value: float, what: str) -> None:
    base = np.full((4, 5, 3), 0.5)
    rough = np.full((4, 5), 0.5)
    header_less = write_maps(tmp_path, BaseColor=base)
    rough[1, 2] = rough[3, 3] = value
    raw_exr(tmp_path / "Roughness.exr", {"Y": rough})
    refused(
        header_less, rf"Roughness\.exr has 2 texels that are {what}, the first in row 1, column 2"
    )
    (tmp_path / "Roughness.exr").unlink()
    base[0, 4, 1] = value
    raw_exr(tmp_path / "BaseColor.exr", {"RGB": base})
    refused(tmp_path, rf"BaseColor\.exr has 1 texels that are {what}, the first in row 0, column 4")


def raw_exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    import OpenEXR

    single = {name: np.ascontiguousarray(pixels, np.float32) for name, pixels in channels.items()}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, single).write(str(path))


@pytest.mark.parametrize(
    ("name", "most"), [("IOR", 1000.0), ("Specular", 100.0), ("SpecularTint", 100.0)]
)
def test_no_socket_is_beyond_what_makes_sense(tmp_path: Path, name: str, most: float) -> None:
    """The limits of the documentation. Together they make no Ks that half floats do not hold."""
    write_maps(tmp_path, BaseColor=[[[0.5, 0.5, 0.5]]])
    raw_exr(tmp_path / f"{name}.exr", {"Y": np.full((1, 1), most)})
    read_principled(tmp_path)
    raw_exr(tmp_path / f"{name}.exr", {"Y": np.full((1, 1), 1.01 * most)})
    refused(tmp_path, rf"{name}\.exr has 1 texels that are above {most:,.0f}")


def test_the_brightest_material_that_is_read_can_be_aged(tmp_path: Path) -> None:
    """Every socket at its limit, some texels dark beside: no frame is NaN, and none says so."""
    spots = np.arange(64).reshape(8, 8) % 3 == 0
    bright = {name: np.where(spots, 65504.0, 0.1) for name in ("R", "G", "B")}
    (tmp_path / "maps").mkdir()
    raw_exr(tmp_path / "maps" / "BaseColor.exr", bright)
    for name, most in (("Specular", 100), ("IOR", 1000), ("SpecularTint", 100), ("Metallic", 0.5)):
        raw_exr(tmp_path / "maps" / f"{name}.exr", {"Y": np.where(spots, most, 0.1)})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for format in ("principled", "torrance-sparrow"):
            for sparse in (False, True):
                output = tmp_path / f"{format}{sparse}"
                run(
                    tmp_path / "maps",
                    output,
                    frames=6,
                    format=format,
                    quality="draft",
                    sparse=sparse,
                    temporal_model="lstm_latents",
                )
                for file in output.glob("*.exr"):
                    assert np.isfinite(read_image(file, color=True)).all(), file.name


def test_metallic_and_roughness_end_at_one(tmp_path: Path) -> None:
    write_maps(tmp_path, BaseColor=[[[2.0, 0.5, 0.5]]], Metallic=[[1.5]], Roughness=[[3.0]])
    maps = read_principled(tmp_path)
    assert maps.metallic.item() == 1
    assert maps.roughness.item() == 1
    assert maps.base_color[0, 0, 0] == 2


def test_paths_that_lead_to_no_material(tmp_path: Path) -> None:
    refused(tmp_path / "absent", "cannot be read")
    refused(Path("with\0zero"), "cannot be read")
    refused(tmp_path, "no base color")
    (tmp_path / "x.fbx").write_text("")
    refused(tmp_path / "x.fbx", "not a material that can be read")
    refused(Path("/dev/null"), "not a material that can be read")
    save(tmp_path / "only_roughness.png")
    refused(tmp_path, "no base color")
    (tmp_path / "x.bsdf").write_text("")
    refused(tmp_path / "x.bsdf", r"x\.bsdf")
    (tmp_path / "x.BINARY").write_text("")
    refused(tmp_path / "x.BINARY", r"x\.BINARY")
    with pytest.raises(InputError):
        hash_input(tmp_path / "absent")


def test_a_broken_image_is_named(tmp_path: Path) -> None:
    save(tmp_path / "x_color.png")
    (tmp_path / "x_roughness.png").write_bytes(b"not a picture")
    refused(tmp_path, r"x_roughness\.png is damaged or not an image")


def test_links_that_loop_leave_or_hang_are_refused(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "set", tmp_path / "elsewhere.png"
    folder.mkdir()
    save(elsewhere)
    (folder / "loop").symlink_to(folder / "loop")
    refused(folder / "loop", "cannot be read")
    (folder / "x_color.png").symlink_to(folder / "x_color.png")
    refused(folder, r"x_color\.png is a link that leads nowhere")
    (folder / "x_color.png").unlink()
    (folder / "x_color.png").symlink_to(elsewhere)
    refused(folder, r"x_color\.png is a link out of its folder")
    (folder / "x_color.png").unlink()
    os.mkfifo(folder / "x_color.png")
    refused(folder, r"x_color\.png is not a file")
    (folder / "x_color.png").unlink()
    save(folder / "x_color.png")
    (tmp_path / "link").symlink_to(folder)
    assert read_principled(tmp_path / "link").size == (8, 8)


def test_a_folder_that_cannot_be_searched_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its names can be listed, and nothing else asked of them."""
    save(tmp_path / "x_color.png")

    def denied(self: Path, strict: bool = False) -> Path:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "resolve", denied)
    error = refused(tmp_path, r"x_color\.png cannot be read: Permission denied")
    assert str(tmp_path) not in error.message


def test_names_that_cannot_be_shown_or_are_endless_are_a_sentence(tmp_path: Path) -> None:
    for path in (
        tmp_path / ("x" * 300),
        tmp_path / ("x/" * 5000),
        tmp_path / "nul\0",
        tmp_path / "half \ud800",
        tmp_path / "\x1b[2J",
    ):
        error = refused(path, "cannot be read")
        assert len(str(error)) < 700
        assert str(error).isprintable()
    folder = tmp_path / "\x1b[2J\udce9"
    folder.mkdir()
    assert str(refused(folder, "no base color")).isprintable()
    save(folder / "\x1b[2Joak_color.png")
    (folder / "\x1b[2Jpine_color.png").write_bytes(b"rubbish")
    assert str(refused(folder, "several materials")).isprintable()
    (folder / "\x1b[2Joak_color.png").unlink()
    assert str(refused(folder, "damaged")).isprintable()


def test_hashes_follow_the_content(tmp_path: Path) -> None:
    save(tmp_path / "x_color.png")
    save(tmp_path / "x_normal.png")
    before = hash_input(tmp_path)
    assert before == {
        "x_color.png": hashlib.sha256((tmp_path / "x_color.png").read_bytes()).hexdigest()
    }
    save(tmp_path / "x_color.png", 129)
    assert hash_input(tmp_path) != before


def test_packed_maps_fill_in_what_is_missing(tmp_path: Path) -> None:
    """Occlusion, roughness and metallic in one image, as Poly Haven and game engines pack them."""
    codes = np.zeros((4, 4, 3), np.uint8)
    codes[...] = (200, 51, 255)
    Image.fromarray(codes).save(tmp_path / "crate_diff_2k.png")
    Image.fromarray(codes).save(tmp_path / "crate_arm_2k.png")
    maps = read_input(tmp_path)
    np.testing.assert_allclose(maps.roughness, 51 / 255, rtol=1e-6)
    np.testing.assert_allclose(maps.metallic, 1.0)
    Image.fromarray(codes[..., 0]).save(tmp_path / "crate_rough_2k.png")
    maps = read_input(tmp_path)
    np.testing.assert_allclose(maps.roughness, 200 / 255, rtol=1e-6)
    np.testing.assert_allclose(maps.metallic, 1.0)
    Image.fromarray(codes[..., 0]).save(tmp_path / "crate_arm_2k.png")
    with pytest.raises(InputError, match="three packed maps"):
        read_input(tmp_path)
