"""Images in and out: values, channels, sizes, damaged files, whole files only."""

from __future__ import annotations

import errno
import os
import struct
import subprocess
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from model_runtime.errors import InputError, OutputError
from model_runtime.images import read_image, resize, write_exr

# IEC 61966-2-1: code value 188 of 255 is 0.5029 of white, 10 is 10 / 255 / 12.92.
SRGB = {0: 0.0, 10: 0.0030353, 188: 0.5028865, 255: 1.0}


def png(pixels: np.ndarray) -> bytes:
    """A PNG of [H, W, C] uint16, written by the specification, rows filtered in turn by 0, 1, 2."""
    height, width, channels = pixels.shape
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    step, rows, before = 2 * channels, b"", np.zeros(2 * channels * width, np.uint8)
    for y in range(height):
        row = np.frombuffer(pixels[y].astype(">u2").tobytes(), np.uint8)
        left = np.concatenate((np.zeros(step, np.uint8), row[:-step]))
        rows += bytes([y % 3]) + (row, row - left, row - before)[y % 3].tobytes()
        before = row

    def chunk(name: bytes, data: bytes) -> bytes:
        checked = name + data
        return struct.pack(">I", len(data)) + checked + struct.pack(">I", zlib.crc32(checked))

    header = struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def tiff(pixels: np.ndarray, *, deflate: bool) -> bytes:
    """A little-endian TIFF of [H, W, 3] uint16 in one strip, written by the specification."""
    height, width, _ = pixels.shape
    data = pixels.astype("<u2").tobytes()
    data = zlib.compress(data) if deflate else data
    entries = [
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 3, 8),
        (259, 3, 1, 8 if deflate else 1),
        (262, 3, 1, 2),
        (273, 4, 1, 14),
        (277, 3, 1, 3),
        (278, 4, 1, height),
        (279, 4, 1, len(data)),
    ]
    table = b"".join(struct.pack("<HHII", *entry) for entry in entries)
    body = struct.pack("<3H", 16, 16, 16) + data
    return (
        struct.pack("<2sHI", b"II", 42, 8 + len(body))
        + body
        + struct.pack("<H", len(entries))
        + table
        + b"\0\0\0\0"
    )


def exr(path: Path, channels: dict[str, np.ndarray]) -> Path:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(path))
    return path


@pytest.mark.parametrize("extension", ["png", "tif", "tiff", "PNG"])
def test_eight_bit_colour_is_decoded_and_data_are_not(tmp_path: Path, extension: str) -> None:
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


def test_alpha_is_dropped_and_grey_is_colour_too(tmp_path: Path) -> None:
    rgba = np.array([[[255, 0, 0, 0], [0, 255, 0, 128]]], np.uint8)
    Image.fromarray(rgba).save(tmp_path / "a.png")
    assert read_image(tmp_path / "a.png", color=True).tolist() == [[[1, 0, 0], [0, 1, 0]]]
    Image.fromarray(np.array([[0, 255]], np.uint8)).save(tmp_path / "g.png")
    assert read_image(tmp_path / "g.png", color=True).tolist() == [[[0, 0, 0], [1, 1, 1]]]
    palette = Image.fromarray(rgba[..., :3]).convert("P", palette=Image.Palette.ADAPTIVE)
    palette.save(tmp_path / "p.png")
    assert read_image(tmp_path / "p.png", color=True).tolist() == [[[1, 0, 0], [0, 1, 0]]]


def test_coloured_data_count_by_luminance(tmp_path: Path) -> None:
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


def test_missing_foreign_and_damaged_files_are_refused(tmp_path: Path) -> None:
    def refused(path: Path, sentence: str) -> None:
        with pytest.raises(InputError, match=sentence) as caught:
            read_image(path, color=True)
        assert path.name in caught.value.message
        assert caught.value.hint

    refused(tmp_path / "absent.png", "is not a file")
    (tmp_path / "folder.png").mkdir()
    refused(tmp_path / "folder.png", "is not a file")
    refused(tmp_path / "x.psd", "not in an image format")
    for extension in ("jpg", "png", "tif", "exr"):
        path = tmp_path / f"x.{extension}"
        path.write_bytes(b"")
        refused(path, "damaged")
        path.write_bytes(os.urandom(1000))
        refused(path, "damaged")
        noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
        if extension == "exr":
            write_exr(path, noise / np.float32(255))
        else:
            Image.fromarray(noise).save(path)
        whole = path.read_bytes()
        for share in (0.02, 0.5, 0.9):
            path.write_bytes(whole[: int(len(whole) * share)])
            refused(path, "damaged")
    (tmp_path / "gif.png").write_bytes(b"GIF89a" + bytes(100))
    refused(tmp_path / "gif.png", "damaged or not an image")


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
        "grey.png": (whole.convert("L"), {"transparency": 3}),
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


def interlaced(codes: np.ndarray) -> bytes:
    """An Adam7 PNG of [H, W] uint8, by the specification: seven passes, each coarser before."""
    rows = b""
    for y, x, down, right in (
        *((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2)),
        *((0, 1, 2, 2), (1, 0, 2, 1)),
    ):
        part = codes[y::down, x::right]
        if part.size:
            rows += b"".join(b"\0" + row.tobytes() for row in part)

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", codes.shape[1], codes.shape[0], 8, 0, 0, 0, 1)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def test_an_interlaced_png(tmp_path: Path) -> None:
    codes = np.random.default_rng(0).integers(0, 256, (13, 11)).astype(np.uint8)
    (tmp_path / "x.png").write_bytes(interlaced(codes))
    np.testing.assert_array_equal(
        read_image(tmp_path / "x.png", color=False), codes.astype(np.float32) / np.float32(255)
    )


def test_damage_is_one_sentence_and_no_library_s(
    tmp_path: Path, recwarn: pytest.WarningsRecorder, capfd: pytest.CaptureFixture[str]
) -> None:
    """OpenEXR and libtiff write to stderr themselves; Pillow warns."""
    codes = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    write_exr(tmp_path / "x.exr", codes.astype(np.float32))
    Image.fromarray(codes).save(tmp_path / "x.tif", compression="tiff_lzw")
    Image.fromarray(codes).save(tmp_path / "y.tif", compression="tiff_adobe_deflate")
    for name in ("x.exr", "x.tif", "y.tif"):
        whole = (tmp_path / name).read_bytes()
        middle = len(whole) // 2
        for damaged in (whole[:middle], whole[:middle] + bytes(200) + whole[middle + 200 :]):
            (tmp_path / name).write_bytes(damaged)
            with pytest.raises(InputError, match="damaged"):
                read_image(tmp_path / name, color=True)
    assert capfd.readouterr().err == ""
    assert not recwarn.list
    os.write(2, b"heard again")
    assert capfd.readouterr().err == "heard again"


def test_the_largest_picture_that_is_allowed_is_read(tmp_path: Path) -> None:
    """Pillow alone would refuse its 180 million pixels as a bomb, and warn of half as many."""
    Image.new("1", (16384, 11000), 1).save(tmp_path / "x.png")
    code = (
        "import sys\nfrom model_runtime.images import read_image\n"
        "print(read_image(sys.argv[1], color=False)[-1, -1])"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "x.png")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("1.0\n", "")


def attribute(name: str, kind: str, value: bytes) -> bytes:
    return b"%s\0%s\0" % (name.encode(), kind.encode()) + struct.pack("<i", len(value)) + value


def tiled_exr(levels: list[np.ndarray]) -> bytes:
    """An EXR of one channel Y with a tile a level, written by the specification."""
    height, width = levels[0].shape
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channel = b"Y\0" + struct.pack("<iB3xii", 1, 0, 1, 1) + b"\0"
    head = struct.pack("<ii", 20000630, 2 | 0x200)
    head += attribute("channels", "chlist", channel)
    head += attribute("compression", "compression", b"\0")
    head += attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box)
    head += attribute("lineOrder", "lineOrder", b"\0")
    head += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", bytes(8))
    head += attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    head += attribute("tiles", "tiledesc", struct.pack("<IIB", width, height, len(levels) > 1))
    head += b"\0"
    table, body = b"", b""
    for k, level in enumerate(levels):
        table += struct.pack("<Q", len(head) + 8 * len(levels) + len(body))
        data = level.astype("<f2").tobytes()
        body += struct.pack("<5i", 0, 0, k, k, len(data)) + data
    return head + table + body


def test_of_a_mipmap_the_largest_level_is_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    levels = [rng.random((side, side)).astype(np.float16) for side in (4, 2, 1)]
    for kept in (levels, levels[:1]):
        (tmp_path / "x.exr").write_bytes(tiled_exr(kept))
        np.testing.assert_array_equal(read_image(tmp_path / "x.exr", color=False), levels[0])


def test_subsampled_channels_are_a_sentence(tmp_path: Path) -> None:
    channel = OpenEXR.Channel("Y", np.zeros((2, 2), np.float16), 2, 2)
    window = (np.array([0, 0], np.int32), np.array([3, 3], np.int32))
    header = {"type": OpenEXR.scanlineimage, "dataWindow": window, "displayWindow": window}
    OpenEXR.File(header, {"Y": channel}).write(str(tmp_path / "x.exr"))
    with pytest.raises(InputError, match="subsampled"):
        read_image(tmp_path / "x.exr", color=False)


def test_deep_data_are_a_sentence(tmp_path: Path) -> None:
    samples = np.empty((4, 4), dtype=object)
    for place in np.ndindex(4, 4):
        samples[place] = np.ones(3, np.float32)
    header = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    for names in ("RGB", "RGBAZ"):
        OpenEXR.File(header, {name: samples.copy() for name in names}).write(
            str(tmp_path / "x.exr")
        )
        with pytest.raises(InputError, match="deep data"):
            read_image(tmp_path / "x.exr", color=True)


HIDDEN = """
import resource, sys
from model_runtime.images import read_image
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(*(read_image(file, color=True).mean() for file in sys.argv[1:]))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory is counted in other units")
def test_what_is_hidden_in_an_exr_takes_no_memory(tmp_path: Path) -> None:
    """Of 64 planes of 1 MB, in twelve parts or in one, three are wanted."""
    plane = np.full((512, 512), 0.5, np.float32)
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    color = dict.fromkeys("RGB", plane)
    parts = [OpenEXR.Part(dict(header), color, name="seen")]
    for k in range(12):
        hidden = dict.fromkeys("ABCDE", plane)
        parts.append(OpenEXR.Part(dict(header), hidden, name=f"hidden {k}"))
    OpenEXR.File(parts).write(str(tmp_path / "parts.exr"))
    channels = color | {f"hidden {k:02}": plane for k in range(61)}
    OpenEXR.File(header, channels).write(str(tmp_path / "channels.exr"))
    words = [sys.executable, "-c", HIDDEN, *map(str, tmp_path.iterdir())]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    *means, grown = map(float, done.stdout.split())
    assert means == [0.5, 0.5]
    assert grown < 30_000, f"{grown:.0f} KB"


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


def test_giants_are_refused_before_they_are_decoded(tmp_path: Path) -> None:
    for width, height in ((16385, 1), (1, 16385)):
        Image.new("L", (width, height)).save(tmp_path / "long.png")
        with pytest.raises(InputError, match="16385") as caught:
            read_image(tmp_path / "long.png", color=False)
        assert "16384" in caught.value.hint
    crowd = {f"hidden {k:03}": np.zeros((1, 16384), np.float16) for k in range(600)}
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, crowd | {"Y": crowd["hidden 000"]}).write(str(tmp_path / "crowd.exr"))
    with pytest.raises(InputError, match="channels"):
        read_image(tmp_path / "crowd.exr", color=False)
    write_exr(tmp_path / "long.exr", np.zeros((1, 16385), np.float32))
    with pytest.raises(InputError, match="16385 x 1"):
        read_image(tmp_path / "long.exr", color=False)
    bomb = bytearray(png(np.zeros((1, 1, 1), np.uint16)))
    bomb[16:24] = struct.pack(">II", 16384, 16384)
    bomb[29:33] = struct.pack(">I", zlib.crc32(bomb[12:29]))
    (tmp_path / "bomb.png").write_bytes(bomb)
    with pytest.raises(InputError, match=r"bomb\.png"):
        read_image(tmp_path / "bomb.png", color=False)


def test_reduction_averages_areas() -> None:
    pixels = np.array([[0, 3, 6, 9, 12, 15]], np.float32)
    assert resize(pixels, (1, 3)).tolist() == [[1.5, 7.5, 13.5]]
    # Six texels on four: each new one covers one and a half.
    np.testing.assert_allclose(
        resize(pixels, (1, 4)), [[(0 + 1.5) / 1.5, (1.5 + 6) / 1.5, (9 + 6) / 1.5, 21 / 1.5]]
    )


def test_enlargement_is_linear_between_centres() -> None:
    found = resize(np.array([[0, 4], [4, 8]], np.float32), (4, 4))
    assert found[0].tolist() == [0, 1, 3, 4]
    assert found[:, 0].tolist() == [0, 1, 3, 4]


@settings(max_examples=100, deadline=None)
@given(*[st.integers(1, 40)] * 4, st.booleans())
def test_resampling_keeps_range_shape_and_mean(h: int, w: int, nh: int, nw: int, rgb: bool) -> None:
    shape = (h, w, 3) if rgb else (h, w)
    pixels = np.random.default_rng(h * 41 + w).random(shape).astype(np.float32)
    found = resize(pixels, (nh, nw))
    assert found.shape == (nh, nw, *shape[2:])
    assert found.dtype == np.float32
    assert found.min() >= pixels.min() - 1e-6
    assert found.max() <= pixels.max() + 1e-6
    if nh <= h and nw <= w:
        np.testing.assert_allclose(found.mean(), pixels.mean(), rtol=1e-4)
    np.testing.assert_allclose(resize(np.full_like(pixels, 0.7), (nh, nw)), 0.7, rtol=1e-6)
