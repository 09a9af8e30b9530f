"""Images in and out: values, channels, sizes, whole files only."""

from __future__ import annotations

import errno
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from model_runtime.errors import InputError, OutputError
from model_runtime.images import read_image, write_exr
from tests.pictures import interlaced, png, tiff, tiled_exr

# IEC 61966-2-1: code value 188 of 255 is 0.5029 of white, 10 is 10 / 255 / 12.92.
SRGB = {0: 0.0, 10: 0.0030353, 188: 0.5028865, 255: 1.0}


def exr(path: Path, channels: dict[str, np.ndarray]) -> Path:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))
    return path


@pytest.mark.parametrize("extension", ["png", "tif", "tiff", "PNG"])
def test_eight_bit_color_is_decoded_and_data_are_not(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"ramp.{extension}"
    codes = np.array([[[code] * 3 for code in SRGB]], np.uint8)
    Image.fromarray(codes).save(path)
    color, data = read_image(path, color=True), read_image(path, color=False)
    assert color.shape == (1, 4, 3)
    assert color.dtype == data.dtype == np.float32
    np.testing.assert_allclose(color[0, :, 1], list(SRGB.values()), rtol=1e-4)
    np.testing.assert_array_equal(
        data[0], np.array([0, 10, 188, 255], np.float32) / np.float32(255)
    )


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_sixteen_bit_png_keeps_all_bits(tmp_path: Path, channels: int) -> None:
    codes = np.random.default_rng(0).integers(0, 65536, (7, 9, channels)).astype(np.uint16)
    path = tmp_path / "deep.png"
    path.write_bytes(png(codes))
    if channels == 1:
        found = read_image(path, color=False)[..., None]
        wanted = codes / 65535
    else:
        found = read_image(path, color=True)
        code = codes[..., :3] / 65535
        wanted = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("deflate", [False, True])
def test_sixteen_bit_tiff_keeps_all_bits(tmp_path: Path, deflate: bool) -> None:
    codes = np.random.default_rng(1).integers(0, 65536, (7, 9, 3)).astype(np.uint16)
    codes[..., 1:] = codes[..., :1]
    path = tmp_path / "deep.tif"
    path.write_bytes(tiff(codes, deflate=deflate))
    np.testing.assert_array_equal(
        read_image(path, color=False), (codes[..., 0] / 65535).astype(np.float32)
    )


def test_alpha_is_dropped_and_gray_is_color_too(tmp_path: Path) -> None:
    rgba = np.array([[[255, 0, 0, 0], [0, 255, 0, 128]]], np.uint8)
    Image.fromarray(rgba).save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png", color=True).tolist() == [[[1, 0, 0], [0, 1, 0]]]
    Image.fromarray(np.array([[0, 255]], np.uint8)).save(tmp_path / "g.png")
    assert read_image(tmp_path / "g.png", color=True).tolist() == [[[0, 0, 0], [1, 1, 1]]]
    palette = Image.fromarray(rgba[..., :3]).convert("P", palette=Image.Palette.ADAPTIVE)
    palette.save(tmp_path / "p.png")
    assert read_image(tmp_path / "p.png", color=True).tolist() == [[[1, 0, 0], [0, 1, 0]]]


def test_colored_data_count_by_luminance(tmp_path: Path) -> None:
    Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]]], np.uint8)).save(tmp_path / "c.png")
    np.testing.assert_allclose(
        read_image(tmp_path / "c.png", color=False), [[0.2126, 0.7152]], rtol=1e-6
    )


def test_jpeg_is_read(tmp_path: Path) -> None:
    Image.fromarray(np.full((16, 24, 3), 188, np.uint8)).save(tmp_path / "x.JPG", "JPEG")
    found = read_image(tmp_path / "x.JPG", color=True)
    assert found.shape == (16, 24, 3)
    np.testing.assert_allclose(found, 0.5029, atol=0.01)


def test_real_textures_are_read(data_folder: Path) -> None:
    folder = data_folder / "pbr" / "Metal035"
    color = read_image(folder / "Metal035_1K-JPG_Color.jpg", color=True)
    metal = read_image(folder / "Metal035_1K-JPG_Metalness.jpg", color=False)
    assert color.shape == (1024, 1024, 3)
    assert metal.shape == (1024, 1024)
    assert color[..., 0].mean() > 2 * color[..., 2].mean(), "copper is orange"
    assert metal.mean() > 0.95


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_channels_of_many_kinds_are_read(tmp_path: Path, dtype: type) -> None:
    rng = np.random.default_rng(0)
    r, g, b, a = rng.normal(0, 100, (4, 3, 5)).astype(dtype)
    rgb = np.stack((r, g, b), -1).astype(np.float32)
    path = tmp_path / "x.exr"
    for names in ({"R": r, "G": g, "B": b, "A": a}, {"r": r, "g": g, "b": b}):
        np.testing.assert_array_equal(read_image(exr(path, names), color=True), rgb)
    layer = {"View.R": r, "View.G": g, "View.B": b, "View.A": a}
    np.testing.assert_array_equal(read_image(exr(path, layer), color=True), rgb)
    for names in ({"Y": r}, {"Y": r, "A": a}, {"V": r}, {"Depth.Z": r}):
        np.testing.assert_array_equal(read_image(exr(path, names), color=False), r)
        assert read_image(path, color=True).shape == (3, 5, 3)
    with pytest.raises(InputError, match="none of them"):
        read_image(exr(path, {"U": r, "V": g}), color=False)


def test_what_is_written_is_read_to_the_half(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for shape in ((1, 1), (1, 1, 3), (37, 53), (37, 53, 3)):
        pixels = rng.normal(0, 10, shape).astype(np.float32)
        path = tmp_path / "x.exr"
        write_exr(path, pixels)
        found = read_image(path, color=len(shape) == 3)
        np.testing.assert_array_equal(found, pixels.astype(np.float16).astype(np.float32))
        names = {channel.name for channel in OpenEXR.File(str(path)).header()["channels"]}
        assert names == ({"Y"} if len(shape) == 2 else {"R", "G", "B"})
    assert [file.name for file in tmp_path.iterdir()] == ["x.exr"]


@pytest.mark.parametrize("channels", [(), (3,)])
def test_halves_are_written_as_they_are_whatever_is_spent_on_size(tmp_path: Path, channels):
    """Planes one after the other too, which is how frames are made."""
    planes = np.random.default_rng(0).random((*channels, 40, 30)).astype(np.float16)
    pixels = np.moveaxis(planes, 0, -1) if channels else planes
    sizes = {}
    for compression in ("none", "zip"):
        path = tmp_path / f"{compression}.exr"
        write_exr(path, pixels, compression=compression)
        np.testing.assert_array_equal(read_image(path, color=bool(channels)), pixels)
        sizes[compression] = path.stat().st_size
    assert sizes["none"] > pixels.nbytes > 0.8 * sizes["zip"]


def test_values_beyond_half_are_clamped(tmp_path: Path) -> None:
    write_exr(tmp_path / "x.exr", np.array([[1e9, -1e9]], np.float32))
    assert read_image(tmp_path / "x.exr", color=False).tolist() == [[65504, -65504]]


def test_many_threads_write_what_one_writes(tmp_path: Path) -> None:
    frames = [np.full((64, 64, 3), index / 16, np.float32) for index in range(32)]
    paths = [tmp_path / f"f_{index:04}.exr" for index in range(32)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write_exr, paths, frames))
    for path, frame in zip(paths, frames, strict=True):
        np.testing.assert_array_equal(read_image(path, color=True), frame)
    write_exr(tmp_path / "again.exr", frames[5])
    assert (tmp_path / "again.exr").read_bytes() == paths[5].read_bytes()


def test_a_place_that_cannot_be_written_to_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.exr").mkdir()
    for path in (
        tmp_path / "absent" / "x.exr",
        tmp_path / "file" / "x.exr",
        tmp_path / "folder.exr",
        Path("/proc/x.exr"),
    ):
        with pytest.raises(OutputError, match="cannot be written") as caught:
            write_exr(path, np.zeros((2, 2), np.float32))
        assert str(path) in caught.value.message
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "folder.exr"]


def test_a_full_disk_leaves_the_earlier_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.exr"
    write_exr(path, np.ones((4, 4), np.float32))

    def full(self: Path, content: bytes) -> int:
        self.touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputError, match="No space left"):
        write_exr(path, np.zeros((4, 4), np.float32))
    assert [file.name for file in tmp_path.iterdir()] == ["x.exr"]
    assert (read_image(path, color=False) == 1).all()


def test_a_writer_of_nan_is_stopped(tmp_path: Path) -> None:
    write_exr(tmp_path / "x.exr", np.ones((4, 4), np.float32))
    for dtype in (np.float16, np.float32):
        for shape in ((4, 5), (4, 5, 3)):
            pixels = np.zeros(shape, dtype)
            pixels[2, 3] = np.nan
            with pytest.raises(OutputError, match=r"x\.exr would hold .* not numbers") as caught:
                write_exr(tmp_path / "x.exr", pixels)
            assert "model file" in caught.value.hint
            assert "map" in caught.value.hint
    assert (read_image(tmp_path / "x.exr", color=False) == 1).all()
    write_exr(tmp_path / "x.exr", np.full((4, 4), -np.inf, np.float32))


def test_what_pillow_makes_of_a_picture_is_read_without_a_word(
    tmp_path: Path, recwarn: pytest.WarningsRecorder, capfd: pytest.CaptureFixture[str]
) -> None:
    """Palettes with alpha, CMYK, animations, pictures that a camera has turned, ..."""
    codes = np.random.default_rng(0).integers(0, 256, (12, 16, 3)).astype(np.uint8)
    whole = Image.fromarray(codes)
    turned = Image.Exif()
    turned[0x0112] = 6
    saved = {
        "palette.png": (whole.convert("P"), {"transparency": bytes(range(200))}),
        "gray.png": (whole.convert("L"), {"transparency": 3}),
        "color.png": (whole, {"transparency": (1, 2, 3)}),
        "animated.png": (whole, {"save_all": True, "append_images": [whole.rotate(180)]}),
        "cmyk.jpg": (whole.convert("CMYK"), {"quality": 100}),
        "progressive.jpg": (whole, {"progressive": True}),
        "turned.jpg": (whole, {"exif": turned}),
        "many.jpg": (whole, {"format": "MPO", "save_all": True, "append_images": [whole]}),
        "pages.tif": (whole, {"save_all": True, "append_images": [whole]}),
        "cmyk.tif": (whole.convert("CMYK"), {"compression": "tiff_lzw"}),
    }
    for name, (image, options) in saved.items():
        image.save(tmp_path / name, **options)
        found = read_image(tmp_path / name, color=True)
        # As Blender does, which turns no picture.
        assert found.shape == (12, 16, 3), name
    assert not recwarn.list
    assert capfd.readouterr().err == ""


def test_an_interlaced_png(tmp_path: Path) -> None:
    codes = np.random.default_rng(0).integers(0, 256, (13, 11)).astype(np.uint8)
    (tmp_path / "x.png").write_bytes(interlaced(codes))
    np.testing.assert_array_equal(
        read_image(tmp_path / "x.png", color=False), codes.astype(np.float32) / np.float32(255)
    )


def test_of_a_mipmap_the_largest_level_is_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    levels = [rng.random((side, side)).astype(np.float16) for side in (4, 2, 1)]
    for kept in (levels, levels[:1]):
        (tmp_path / "x.exr").write_bytes(tiled_exr(kept))
        np.testing.assert_array_equal(read_image(tmp_path / "x.exr", color=False), levels[0])


@pytest.mark.skipif(sys.platform != "linux", reason="others have names in Unicode alone")
def test_a_name_that_is_not_utf8_is_a_name(tmp_path: Path) -> None:
    plain, folder = tmp_path / "plain", tmp_path / os.fsdecode(b"caf\xe9")
    plain.mkdir()
    codes = np.full((4, 4), 255, np.uint8)
    Image.fromarray(codes).save(plain / "x.png")
    Image.fromarray(codes).save(plain / "x.tif", compression="tiff_lzw")
    write_exr(plain / "x.exr", np.ones((4, 4), np.float32))
    plain.rename(folder)
    for path in folder.iterdir():
        assert (read_image(path, color=False) == 1).all()
