"""Images that are damaged, hostile or of a kind that is not read: a sentence, and no memory."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from model_runtime.errors import InputError
from model_runtime.images import read_image, write_exr
from tests.pictures import png


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
