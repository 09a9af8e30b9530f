"""`--command age_material --bind`: what another machine computed is shown as if aged here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import (
    add_sun,
    awkward,
    new_material,
    plane,
    render,
    snapshot,
    textured,
    view_from_above,
)
from tests.blender.surface_truth import everything, monkey, tiled, without_uvs
from tests.blender.test_surface_maps_bound import tiles
from tvbrdf.tvbrdf_addon import session
from tvbrdf.tvbrdf_addon.headless.command import main
from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged

USUAL = ("--frames", "1-20")
AGED = ("--ntm", "rust", *USUAL, "--steps", "4", "--size", "32")


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def save() -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(Path("file.blend").absolute()))


def reopen() -> None:
    bpy.ops.wm.open_mainfile(filepath=str(Path("file.blend").absolute()))


def seen() -> dict[str, object]:
    """All that there is in the file, at its first frame, and what the panel says of it."""
    bpy.context.scene.frame_set(1)
    kept = ("folder", "keyed", "is_preview", "size_reason", "frame_start", "frame_end", "original")
    return everything() | {
        f"material {each.name}": (
            snapshot(each),
            [np.ravel(getattr(each.tvbrdf, name)).tolist() for name in kept],
        )
        for each in bpy.data.materials
    }


def images(material: bpy.types.Material) -> None:
    """Textures that repeat."""
    textured(material, np.random.default_rng(1).random((8, 8, 3)))
    tiled(material)


def baked(material: bpy.types.Material) -> None:
    awkward(material)
    monkey(material)


def one_alike(material: bpy.types.Material) -> None:
    material.tvbrdf.use_alike = True
    tiles(material)


@pytest.mark.usefixtures("stub_worker")
@pytest.mark.parametrize("build", [images, baked, tiled, tiles, one_alike, without_uvs])
@pytest.mark.parametrize(
    "words", [(), ("--binding", "frames", "--format", "exact")], ids=["live", "frames"]
)
def test_it_is_bound_as_the_run_itself_binds_it(
    folder: Path, build: Callable[[bpy.types.Material], object], words: tuple[str, ...]
):
    if build is without_uvs and words:
        pytest.skip("frames need a UV map")
    build(new_material())
    save()
    aging = ["--all", *AGED, *words, "--output", "results"]
    assert main(aging) == 0
    in_place = seen()
    reopen()
    assert main([*aging, "--bind", "results"]) == 0
    assert is_aged(bpy.data.materials["Paint"])
    assert seen() == in_place


@pytest.mark.usefixtures("stub_worker")
def test_many_tasks_age_and_one_binds(folder: Path, monkeypatch):
    """Two materials of one mesh, each of which gets a UV map of its own."""
    first, second = new_material("Left"), new_material("Right")
    obj = tiled(first)[0]
    obj.data.materials.append(second)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide()
    bpy.ops.object.mode_set(mode="OBJECT")
    obj.data.polygons[0].material_index = 1
    save()
    assert main(["--all", *AGED, "--output", "results"]) == 0
    in_place = seen()
    for name in ("Right", "Left"):
        reopen()
        assert main(["--material", name, *AGED, "--output", "results"]) == 0
    reopen()
    session.stop_worker()
    monkeypatch.setenv("TVBRDF_WORKER", "/nowhere/worker")
    assert main(["--all", *USUAL, "--bind", "results", "--save-as", "aged.blend"]) == 0
    assert [each.name for each in bpy.data.meshes[0].uv_layers] == ["UVMap", "Age", "Age 2"]
    bpy.ops.wm.open_mainfile(filepath=str(folder / "file.blend"))
    assert main(["--all", *AGED, "--bind", "results"]) == 0
    assert seen() == in_place


@pytest.mark.usefixtures("stub_worker")
def test_a_result_that_is_not_there_fails_where_it_was_named(folder: Path, capfd):
    for name in ("Paint", "Steel", "A/B", "A_B"):
        plane(new_material(name))
    save()
    assert main(["--material", "Paint", "--material", "A/B", *AGED, "--output", "results"]) == 0
    reopen()
    assert main(["--all", *USUAL, "--bind", "results"]) == 0
    out = capfd.readouterr().out
    assert "Steel: Left out: There is no result of “Steel” in" in out
    assert "A/B: Left out: “A/B” has the folder A_B in common with another material" in out
    assert {each.name for each in bpy.data.materials if is_aged(each)} == {"Paint"}
    reopen()
    words = ["--material", "Steel", "--material", "Paint", *USUAL, "--bind", "results"]
    assert main([*words, "--save-as", "aged.blend"]) == 1
    assert "Not aged: Steel. aged.blend was not written." in capfd.readouterr().err
    assert {each.name for each in bpy.data.materials if is_aged(each)} == {"Paint"}


@pytest.mark.usefixtures("stub_worker")
def test_what_is_shown_already_is_no_news(folder: Path, capfd):
    """A task that ages it again writes beside what the file shows: that is not to be bound."""
    plane(new_material())
    save()
    assert main(["--all", *AGED, "--output", "results", "--save-as", "file.blend"]) == 0
    reopen()
    assert main(["--material", "Paint", *USUAL, "--bind", "results"]) == 1
    assert "shows the result in" in capfd.readouterr().err


@pytest.mark.usefixtures("stub_worker")
@pytest.mark.parametrize("report", ["{}", "[" * 100_000, '{"command": "\'", "binding": 3}'])
def test_a_damaged_result_leaves_the_material_as_it_was(folder: Path, capfd, report: str):
    plane(new_material())
    save()
    assert main(["--all", *AGED, "--output", "results"]) == 0
    (folder / "results" / "Paint" / "aged.json").write_text(report)
    reopen()
    before = seen()
    assert main(["--material", "Paint", "--frames", "1-250", "--bind", "results"]) == 1
    assert "damaged" in capfd.readouterr().err
    assert not is_aged(bpy.data.materials["Paint"])
    assert seen()["meshes"] == before["meshes"]
    assert main(["--material", "Paint", *USUAL, "--bind", "nowhere"]) == 1
    assert "There is no folder" in capfd.readouterr().err


@pytest.mark.slow
def test_it_renders_the_same(folder: Path):
    """With the real worker: a surface without UVs, half of whose places have aged."""
    without_uvs(new_material())
    view_from_above()
    add_sun((0, 0.3, -1))
    save()
    aging = ["--all", *AGED, "--output", "results"]
    assert main(aging) == 0
    first, in_place = (render(folder / f"in_place{i}.exr", i, size=32) for i in (1, 12))
    reopen()
    assert main(["--all", *USUAL, "--bind", "results"]) == 0
    assert np.abs(in_place - first).max() > 0.05
    np.testing.assert_array_equal(render(folder / "bound.exr", 12, size=32), in_place)
