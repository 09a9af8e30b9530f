"""Images between the runtime and Blender: each shows what the other has written."""

# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false
# pyright: reportIndexIssue=false, reportReturnType=false

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from model_runtime.images import read_image, write_exr


@pytest.fixture
def scene() -> bpy.types.Scene:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


def shown(path: Path) -> np.ndarray:
    """[H, W, 3] that Blender's Image Texture node gives with Non-Color; row 0 is the top."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    return np.array(image.pixels[:], np.float32).reshape(height, width, -1)[::-1, :, :3]


@pytest.mark.parametrize("shape", [(6, 5, 3), (6, 5), (1, 1, 3), (1, 1)])
def test_blender_shows_what_was_written(
    scene: bpy.types.Scene, tmp_path: Path, shape: tuple[int, ...]
) -> None:
    pixels = np.random.default_rng(0).normal(0, 1, shape).astype(np.float16).astype(np.float32)
    write_exr(tmp_path / "map.exr", pixels)
    expected = pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, -1)
    np.testing.assert_array_equal(shown(tmp_path / "map.exr"), expected)


@pytest.mark.parametrize("depth", ["8", "16"])
@pytest.mark.parametrize("mode", ["BW", "RGB", "RGBA"])
@pytest.mark.parametrize(("kind", "extension"), [("PNG", "png"), ("TIFF", "tif")])
def test_images_saved_by_blender_are_read_as_blender_reads_them(
    scene: bpy.types.Scene, tmp_path: Path, kind: str, extension: str, mode: str, depth: str
) -> None:
    painted = bpy.data.images.new("painted", 9, 4, float_buffer=True)
    pixels = np.random.default_rng(0).random((4 * 9, 4), np.float32)
    pixels[:, 3] = 1
    painted.pixels = pixels.ravel()
    wanted = {"file_format": kind, "color_mode": mode, "color_depth": depth}
    for name, value in wanted.items():
        setattr(scene.render.image_settings, name, value)
    path = tmp_path / f"painted.{extension}"
    painted.save_render(str(path), scene=scene)

    code = shown(path)
    if mode == "BW":
        np.testing.assert_allclose(read_image(path, color=False), code[..., 0], atol=1e-6)
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    # Of premultiplied 16-bit color, as Blender's TIFFs with alpha hold, 8 bits are read.
    tolerance = 2.3 / 255 if (kind, mode, depth) == ("TIFF", "RGBA", "16") else 1e-5
    np.testing.assert_allclose(read_image(path, color=True), linear, atol=tolerance)
