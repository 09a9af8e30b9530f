"""`blender -b file.blend --command age_material ...`: exit codes and what is written.

The Blender module has no dispatcher, so the registered function is called.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import pixels
from tests.blender.three_planes import USUAL, aged, build
from tvbrdf.tvbrdf_addon import session
from tvbrdf.tvbrdf_addon.headless.command import main

pytestmark = pytest.mark.usefixtures("stub_worker")


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a saved file with three planes of Steel, Copper and Oak."""
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0")
    monkeypatch.chdir(tmp_path)
    build(tmp_path)
    return tmp_path


def test_many_materials_each_in_its_folder(folder: Path):
    words = ["--material", "Steel", "--material", "Oak", *USUAL, "--output", "//results"]
    assert main(words) == 0
    assert aged() == {"Steel", "Oak"}
    assert (folder / "results" / "Steel" / "aged.json").is_file()
    assert (folder / "results" / "Oak" / "aged.json").is_file()


def test_the_object_that_is_named_is_read(folder: Path, capfd):
    """Both show Steel; of the second only the bake of what varies with the place tells."""
    steel = bpy.data.materials["Steel"]
    bpy.data.objects["Plane.001"].data.materials[0] = steel
    bpy.data.objects["Plane.001"].data.uv_layers[0].data[0].uv.x = 7
    tree = steel.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs[0], tree.nodes["Principled BSDF"].inputs["Roughness"])
    words = ["--material", "Steel", *USUAL]
    assert main([*words, "--object", "Plane.001"]) == 1
    assert "“Plane.001” reaches outside the square" in capfd.readouterr().err
    assert main([*words, "--object", "Nobody"]) == 1
    assert "no object called Nobody. Steel is shown by Plane, Plane.001." in capfd.readouterr().err
    assert main([*words, "--object", "Plane"]) == 0


def test_an_output_with_backslashes_is_beside_the_file(folder: Path):
    assert main(["--material", "Steel", *USUAL, "--output", "//tex\\aged\\"]) == 0
    assert (folder / "tex" / "aged" / "Steel" / "aged.json").is_file()


def test_without_save_as_the_file_is_left_as_it_was(folder: Path):
    before = (folder / "file.blend").read_bytes()
    assert main(["--material", "Steel", *USUAL]) == 0
    assert (folder / "file.blend").read_bytes() == before


def test_save_as_elsewhere_finds_its_textures(folder: Path):
    (folder / "deep" / "er").mkdir(parents=True)
    words = ["--material", "Steel", *USUAL, "--save-as", "deep/er/aged.blend"]
    assert main(words) == 0
    bpy.ops.wm.open_mainfile(filepath=str(folder / "deep" / "er" / "aged.blend"))
    assert aged() == {"Steel"}
    images = [image for image in bpy.data.images if "tvbrdf" in image]
    assert images
    for image in images:
        assert image.filepath.startswith("//")
        assert Path(bpy.path.abspath(image.filepath)).is_file()


def test_paths_without_slashes_are_the_shells(folder: Path, tmp_path_factory, monkeypatch):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    monkeypatch.chdir(elsewhere)
    words = ["--material", "Steel", *USUAL, "--output", "here", "--save-as"]
    assert main([*words, "//beside.blend"]) == 0
    assert (folder / "beside.blend").is_file()
    assert main([*words, "here.blend"]) == 0
    assert (elsewhere / "here.blend").is_file()
    assert (elsewhere / "here" / "Steel" / "aged.json").is_file()


def test_what_was_asked_for_is_kept_in_the_material(folder: Path):
    words = [
        *("--material", "Steel", "--ntm", "rust", "--frames", "5-9", "--steps", "3"),
        *("--quality", "draft", "--tolerance", "40", "--temporal-model", "affine"),
        *("--onset", "none", "--seed", "8", "--format", "as-authored", "--specular", "mono"),
        *("--grain", "0.5", "--relief", "0"),
    ]
    assert main(words) == 0
    kept = bpy.data.materials["Steel"].tvbrdf
    assert (kept.frame_start, kept.frame_end, kept.steps, kept.seed) == (5, 9, 3, 8)
    assert (kept.quality, kept.tolerance, kept.temporal_model) == ("draft", 40.0, "affine")
    assert (kept.onset, kept.format, kept.specular) == ("none", "as-authored", "mono")
    assert (kept.grain, kept.relief) == (0.5, 0.0)


def test_the_start_is_an_image_or_an_attribute_inverted_or_not(folder: Path):
    """Each time what is not named stays as it was, as with all other settings."""
    kept = bpy.data.materials["Steel"].tvbrdf
    bpy.data.objects["Plane"].data.color_attributes.new("Wear", "BYTE_COLOR", "CORNER")
    bpy.data.images.new("Painted", 4, 4).pack()
    mask = bpy.data.images.new("disk", 4, 4)
    mask.save(filepath=str(folder / "mask.png"))
    words = ["--material", "Steel", "--ntm", "rust", "--frames", "1-20", "--steps", "4"]

    def start(*more: str) -> tuple[str, str, str, bool]:
        assert main([*words, "--size", "16", *more]) == 0
        image = kept.onset_image.name if kept.onset_image else ""
        return kept.onset, image, kept.onset_attribute, kept.onset_invert

    assert start("--onset", "mask.png") == ("image", "mask.png", "", False)
    assert start("--onset", "//mask.png", "--onset-invert") == ("image", "mask.png", "", True)
    assert start("--onset", "Painted") == ("image", "Painted", "", True)
    assert start("--onset", "attribute:Wear") == ("attribute", "Painted", "Wear", True)
    assert start("--no-onset-invert") == ("attribute", "Painted", "Wear", False)
    assert start("--onset", "auto") == ("auto", "Painted", "Wear", False)


def test_a_mask_is_kept_as_the_panel_keeps_it(folder: Path):
    plane = bpy.data.objects["Plane"]
    plane.data.color_attributes.new("Wear", "BYTE_COLOR", "CORNER")
    bpy.data.images.new("Painted", 4, 4)
    kept = bpy.data.materials["Steel"].tvbrdf
    words = ["--material", "Steel", *USUAL[:6], "--size", "16"]

    def mask(*options: str) -> tuple[str, str, str, str]:
        assert main([*words, *options]) == 0
        image = kept.mask_image.name if kept.mask_image else ""
        return kept.mask_source, image, kept.mask_attribute, kept.mask_means

    assert mask("--mask", "attribute:Wear") == ("attribute", "", "Wear", "first")
    assert mask("--mask-means", "only") == ("attribute", "", "Wear", "only")
    assert mask("--mask", "Painted", "--mask-means", "never") == (
        *("image", "Painted", "Wear", "never"),
    )
    assert mask("--mask", "none") == ("none", "Painted", "Wear", "never")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--mask-means", "only"), "Nothing grows by a mask"),
        (("--mask", "no.png"), "There is no file"),
        (("--mask", "attribute:Wear"), "no color attribute “Wear”"),
        (("--mask", "file.blend"), "cannot be read as an image"),
    ],
)
def test_a_mask_that_cannot_count_is_refused(folder: Path, capfd, options, said):
    assert main(["--material", "Steel", *USUAL[:6], "--size", "16", *options]) == 1
    assert said in capfd.readouterr().err
    assert not aged()


@pytest.mark.slow
def test_it_starts_where_it_was_painted(folder: Path, monkeypatch):
    """With the real worker: what is white on the mesh, or inverted what is black, starts last."""
    monkeypatch.delenv("TVBRDF_WORKER")
    mesh = bpy.data.objects["Plane"].data
    wear = mesh.color_attributes.new("Wear", "FLOAT_COLOR", "POINT")
    for vertex, element in zip(mesh.vertices, wear.data, strict=True):
        element.color = (*[(vertex.co.x + 1) / 2] * 3, 1)
    changes = []
    for output, invert in (("black", "--no-onset-invert"), ("white", "--onset-invert")):
        words = ["--material", "Steel", *USUAL, "--onset", "attribute:Wear", "--output", output]
        words += [invert, "--binding", "frames", "--quality", "exact"]  # every frame is stored
        words += ["--grain", "0"]  # which differs from texel to texel, wherever it starts
        assert main(words) == 0
        maps = [pixels(folder / output / "Steel" / f"base_color_{i:04d}.exr") for i in (1, 2, 4)]
        changes.append([np.abs(each - maps[0]).sum((0, 2)) for each in maps[1:]])
    for early, last in changes:
        assert early.shape == (16,)
        assert last.max() > 1
    (early, last), (early_inverted, last_inverted) = changes
    assert (early[:5] > 0).all() and (early[6:] == 0).all(), "a third of the time has passed"
    assert last[-1] < 0.6 * last[0]
    # Of the whole change: where it has hardly begun, a digit of the onset is much of it.
    np.testing.assert_allclose(early_inverted[::-1], early, atol=3e-3 * early.max())
    np.testing.assert_allclose(last_inverted[::-1], last, atol=3e-3 * last.max())


def test_the_size_that_the_cameras_see_is_said(folder: Path, capfd):
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location.z = "ORTHO", 2.0, 3.0
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = 128
    steel = bpy.data.materials["Steel"]
    steel.tvbrdf.size = 100
    words = ["--material", "Steel", "--ntm", "rust", "--frames", "1-20", "--steps", "4"]
    assert main([*words, "--size", "auto"]) == 0
    assert "Steel: 256 px is all the cameras see." in capfd.readouterr().out
    assert steel.tvbrdf.size_reason == "256 px is all the cameras see."
    assert main([*words, "--size", "32"]) == 0
    assert "the cameras see" not in capfd.readouterr().out
    assert (steel.tvbrdf.use_camera_size, steel.tvbrdf.size) == (False, 32)


def test_one_failure_does_not_keep_the_others_but_is_the_exit_code(folder: Path, capfd):
    bpy.data.materials["Steel"].node_tree.nodes.clear()
    words = ["--material", "Steel", "--material", "Oak", *USUAL, "--save-as", "aged.blend"]
    assert main(words) == 1
    assert aged() == {"Oak"}
    assert not (folder / "aged.blend").exists()
    err = capfd.readouterr().err
    assert "Not aged: Steel. aged.blend was not written." in err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["--material", "Cooper", *USUAL],
            "There is no material called Cooper. Did you mean Copper?",
        ),
        (["--material", "Steel", "--ntm", "frost", "--frames", "1-9"], "no model called 'frost'"),
        (["--material", "Steel", *USUAL, "--save-as", "nowhere/x.blend"], "There is no folder"),
        (["--material", "Steel", *USUAL, "--save-as", ""], "is no file. Name the .blend to save."),
        (["--material", "Steel", *USUAL, "--output", ""], "There is no output folder"),
        (["--material", "Steel", *USUAL, "--onset", "no.png"], "There is no file"),
        (["--material", "Steel", *USUAL, "--onset", "file.blend"], "cannot be read as an image"),
        (["--material", "Steel", *USUAL, "--onset-invert"], "There is no start image to invert"),
        (
            ["--material", "Steel", *USUAL, "--onset", "attribute:Wear"],
            "“Plane” has no color attribute “Wear”: paint one in Vertex Paint mode.",
        ),
    ],
)
def test_what_is_not_there_is_said_before_any_work(
    folder: Path, capfd, words: list[str], sentence: str
):
    assert main(words) == 1
    assert sentence in capfd.readouterr().err
    assert aged() == set()
    assert [path.name for path in folder.iterdir()] == ["file.blend"]


def test_a_file_that_was_not_opened_is_not_mistaken(folder: Path, capfd, monkeypatch):
    """Blender goes on with the file that it starts with."""
    monkeypatch.setattr(sys, "argv", ["blender", "-b", "gone.blend", "--command", "age_material"])
    bpy.ops.wm.read_homefile()
    output = ["--output", str(folder / "aged"), "--save-as", "x.blend"]
    assert main(["--all", *USUAL, *output]) == 1
    assert "gone.blend was not opened." in capfd.readouterr().err
    monkeypatch.setattr(sys, "argv", ["blender", "-b", "--command", "age_material"])
    assert main(["--all", *USUAL, *output]) == 0, "a script may have made it"


@pytest.mark.skipif(os.name == "nt", reason="Windows has drives and no named pipes")
@pytest.mark.parametrize("output", ["C:\\tex\\aged", "d:/tex", "\\\\server\\share"])
def test_an_output_on_a_drive_of_windows_is_no_folder_here(folder: Path, capfd, output: str):
    assert main(["--material", "Steel", *USUAL, "--output", output]) == 1
    assert "is on a drive of Windows" in capfd.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["file.blend"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no named pipes")
def test_only_a_file_is_saved_over(folder: Path, capfd):
    os.mkfifo(folder / "pipe")
    assert main(["--material", "Steel", *USUAL, "--save-as", "pipe"]) == 1
    assert "is no file" in capfd.readouterr().err
    assert (folder / "pipe").is_fifo()


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--material", "Steel"],
        ["--material", "Steel", "--ntm", "rust", "--frames", "9-1"],
        ["--material", "Steel", "--ntm", "rust", "--frames", "5"],
        ["--material", "Steel", *USUAL, "--steps", "1"],
        ["--material", "Steel", *USUAL, "--quality", "best"],
        ["--material", "Steel", *USUAL, "--tolerance", "lots"],
        ["--material", "Steel", *USUAL, "--surprise"],
        ["--material", "Steel", *USUAL, "--size", "large"],
        ["--material", "Steel", *USUAL, "--seed", str(2**31)],
        ["--material", "Steel", *USUAL, "--steps", "9" * 400],
        ["--material", "Steel", *USUAL, "--seed", "9" * 5000],
        ["--material", "Steel", *USUAL, "--tolerance", "nan"],
        ["--material", "Steel", *USUAL, "--grain", "2"],
        ["--material", "Steel", *USUAL, "--relief", "nan"],
        ["--material", "Steel", "--ntm", "rust", "--frames", "1-2147483648"],
        ["--material", "Steel", "--ntm", "rust", "--frames", "-9999999-5"],
    ],
)
def test_wrong_usage(folder: Path, words: list[str]):
    assert main(words) == 2
    assert aged() == set()


@pytest.fixture
def _heard() -> Iterator[None]:
    """SIGINT as a shell's foreground has it: tests may run in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_heard")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_ends_it_and_leaves_nothing_half_done(
    folder: Path, capfd, monkeypatch, number: int, code: int
):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "30")
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    materials = ["--material", "Steel", "--material", "Copper", "--material", "Oak"]
    words = [*materials, *USUAL, "--steps", "600", "--save-as", "aged.blend"]
    killer = threading.Thread(target=lambda: interrupt_when_aging(number))
    killer.start()
    try:
        assert main(words) == code
    finally:
        killer.join()
    out, err = capfd.readouterr()
    assert aged() == set()
    assert "Steel: Canceled" in err
    assert "Not aged: Steel, Copper, Oak. aged.blend was not written." in err
    assert "Copper:" not in out, "it was not even begun"
    assert not [path for path in folder.rglob("*") if "partial" in path.name]
    assert not (folder / "aged.blend").exists()
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def interrupt_when_aging(number: int) -> None:
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        run = session.current()
        if run is not None and run.fraction > 0:
            os.kill(os.getpid(), number)
            return
        time.sleep(0.02)


def test_what_nobody_foresaw_is_one_sentence_and_a_log(folder: Path, capfd, monkeypatch):
    def broken(*_arguments: object, **_settings: object) -> None:
        raise ZeroDivisionError("what was it")

    monkeypatch.setattr("tvbrdf.tvbrdf_addon.session.plan", broken)
    assert main(["--material", "Steel", *USUAL]) == 1
    err = capfd.readouterr().err
    assert "Steel: This should not happen (ZeroDivisionError: what was it). Please report" in err
    assert "Traceback" not in err
    log = Path(re.search(r"send the file (\S+)\.\n", err)[1])
    assert "what was it" in log.read_text().rpartition("Traceback")[2]


@pytest.mark.parametrize("name", ["stdout", "stderr"])
def test_it_ages_where_nobody_listens(folder: Path, monkeypatch, name: str):
    full = os.fdopen(os.open("/dev/full", os.O_WRONLY), "w")
    monkeypatch.setattr(sys, name, full)
    assert main(["--material", "Steel", *USUAL]) == 0
    with contextlib.suppress(OSError):
        full.close()
    assert aged() == {"Steel"}


def test_help_is_no_failure(empty_scene: bpy.types.Scene, capsys):
    assert main(["--help"]) == 0
    assert "--command age_material" in capsys.readouterr().out
