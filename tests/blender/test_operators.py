"""The operators as a script without a window calls them; the stub stands in for the computing."""

from __future__ import annotations

import json
import os
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import bpy
import pytest

from tvbrdf.tvbrdf_addon import preferences, session
from tvbrdf.tvbrdf_addon.errors import RunEndedError, SettingsError
from tvbrdf.tvbrdf_addon.material.nodes.record import is_live
from tvbrdf.tvbrdf_addon.material.nodes.revert import is_aged
from tvbrdf.tvbrdf_addon.run import Run

pytestmark = pytest.mark.usefixtures("stub_worker")
STEPS = 4


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path) -> Path:
    """The folder of a saved file with one material, Steel, on a plane."""
    add_material("Steel")
    empty_scene.frame_start, empty_scene.frame_end = 1, 20
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    return tmp_path


def add_material(name: str) -> bpy.types.Material:
    bpy.ops.mesh.primitive_plane_add()
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    bpy.context.object.data.materials.append(material)
    # Uniform and aged everywhere at once is quickest; the stub's maps are textures all the same.
    material.tvbrdf.steps, material.tvbrdf.size, material.tvbrdf.onset = STEPS, 16, "none"
    return material


def age(name: str = "") -> set[str]:
    return bpy.ops.tvbrdf.age_material(material=name)


def steel() -> bpy.types.Material:
    return bpy.data.materials["Steel"]


def image_folders(material: bpy.types.Material) -> set[str]:
    groups = [node.node_tree for node in material.node_tree.nodes if node.type == "GROUP"]
    nodes = [node for tree in (material.node_tree, *groups) for node in tree.nodes]
    images = [node.image for node in nodes if node.type == "TEX_IMAGE"]
    return {Path(bpy.path.abspath(image.filepath)).parent.name for image in images if image}


def left_behind(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if "partial" in path.name or path.suffix == ".exr"]


def test_age_the_active_material(folder: Path):
    assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
    assert is_aged(steel())
    aged = json.loads((folder / "aged" / "Steel" / "aged.json").read_text())
    assert aged["frames"] == STEPS
    assert steel().tvbrdf.folder == "//aged/Steel"


@pytest.mark.parametrize(("binding", "said"), [("live", False), ("frames", True)])
def test_what_maps_lose_is_said_where_maps_are_shown(folder: Path, binding: str, said: bool):
    tree = steel().node_tree
    principled = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    fresnel = tree.nodes.new("ShaderNodeFresnel")
    tree.links.new(fresnel.outputs[0], principled.inputs["Roughness"])
    steel().tvbrdf.binding = binding
    assert age("Steel") == {"FINISHED"}
    sentences = session.outcome().sentences
    assert any("direction of view" in sentence for sentence in sentences) is said


def test_age_a_material_by_name(folder: Path):
    add_material("Copper")
    assert age("Steel") == {"FINISHED"}
    assert is_aged(steel())
    assert not is_aged(bpy.data.materials["Copper"])


def test_the_range_is_keyed(folder: Path):
    steel().tvbrdf.frame_start, steel().tvbrdf.frame_end = 11, 51
    age()
    ages = {}
    for frame in (1, 11, 31, 51, 60):
        bpy.context.scene.frame_set(frame)
        ages[frame] = steel()["Age"]
    assert ages == pytest.approx({1: 0.0, 11: 0.0, 31: 0.5, 51: 1.0, 60: 1.0})


def test_revert_and_revert_again(folder: Path):
    age()
    assert bpy.ops.tvbrdf.revert() == {"FINISHED"}
    assert not is_aged(steel())
    with pytest.raises(RuntimeError, match="Steel is not aged"):
        bpy.ops.tvbrdf.revert(material="Steel")


def test_freeze(folder: Path):
    age()
    bpy.context.scene.frame_set(10)
    assert bpy.ops.tvbrdf.freeze() == {"FINISHED"}
    assert is_aged(steel())
    assert not is_live(steel())
    assert image_folders(steel()) == {"frame 10"}
    assert bpy.ops.tvbrdf.revert() == {"FINISHED"}
    with pytest.raises(RuntimeError, match="not aged"):
        bpy.ops.tvbrdf.freeze(material="Steel")


def test_what_computes_is_said_once_it_is_known(folder: Path):
    session.stop_worker()
    assert session.worker_in_words() == "The worker starts with the next run."
    assert age() == {"FINISHED"}
    assert session.worker_in_words() == "The worker is ready, with Flat Colors 1.0 on the CPU."


def test_bake_frames(folder: Path):
    age()
    assert is_live(steel())
    assert bpy.ops.tvbrdf.bake_frames() == {"FINISHED"}
    assert not is_live(steel())
    assert "SEQUENCE" in {image.source for image in bpy.data.images}
    assert image_folders(steel()) == {"Steel.001"}
    assert len(list((folder / "aged" / "Steel.001").glob("base_color_*.exr"))) == STEPS
    assert age() == {"FINISHED"}
    assert is_live(steel())


def test_two_materials_do_not_share_a_folder(folder: Path):
    # File-safe, both would be called a_b.
    for name in ("a/b", "a:b"):
        add_material(name)
        assert age(name) == {"FINISHED"}
    assert image_folders(bpy.data.materials["a/b"]) == {"a_b"}
    assert image_folders(bpy.data.materials["a:b"]) == {"a_b.001"}


def test_aging_again_leaves_the_shown_files_alone(folder: Path):
    """An undo, or closing without saving, must find the textures that it shows."""
    age()
    before = {p: p.read_bytes() for p in (folder / "aged" / "Steel").iterdir()}
    assert age() == {"FINISHED"}
    assert {p: p.read_bytes() for p in (folder / "aged" / "Steel").iterdir()} == before
    assert image_folders(steel()) == {"Steel.001"}


def test_a_copy_of_an_aged_material_keeps_its_files(folder: Path):
    age()
    copy = steel().copy()
    age("Steel")
    age("Steel")
    assert image_folders(copy) == {"Steel"}
    assert (folder / "aged" / "Steel" / "aged.json").is_file()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda m: setattr(m.tvbrdf, "output", ""), "no output folder"),
        (lambda m: setattr(m.tvbrdf, "frame_end", -5), "is empty"),
        (lambda m: setattr(m.tvbrdf, "ntm", "file"), "No model is chosen"),
        (lambda m: setattr(m.tvbrdf, "onset", "image"), "No start image"),
        (lambda m: m.node_tree.nodes.clear(), "Material Output"),
    ],
)
def test_what_cannot_be_done_is_said(folder: Path, change: Callable, sentence: str):
    change(steel())
    with pytest.raises(RuntimeError, match=sentence):
        age()
    assert not is_aged(steel())
    assert session.current() is None


def test_unknown_names_get_the_closest(folder: Path):
    with pytest.raises(RuntimeError, match="Did you mean Steel"):
        age("steal")


def test_no_material(empty_scene: bpy.types.Scene):
    with pytest.raises(RuntimeError, match="no material here"):
        age()


def test_an_unsaved_file_has_no_folder(empty_scene: bpy.types.Scene, tmp_path: Path):
    material = add_material("Steel")
    with pytest.raises(RuntimeError, match="not saved yet"):
        age()
    material.tvbrdf.output = str(tmp_path)
    assert age() == {"FINISHED"}
    assert Path(material.tvbrdf.folder) == tmp_path / "Steel"


def test_an_unsaved_file_is_aged_in_a_new_folder_each_time(
    empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(preferences, "kept_apart", lambda: tmp_path)
    material = add_material("Steel")
    assert age() == {"FINISHED"}
    first = Path(material.tvbrdf.folder)
    assert first.relative_to(tmp_path).parts[1:] == ("aged", "Steel")
    time.sleep(1.1)
    assert age() == {"FINISHED"}
    assert Path(material.tvbrdf.folder) != first and first.is_dir()


def test_an_output_that_is_a_file(folder: Path):
    (folder / "aged").write_text("not a folder")
    with pytest.raises(RuntimeError, match="is a file, not a folder"):
        age()


def test_a_failure_of_the_worker_changes_nothing(folder: Path, monkeypatch):
    age()
    original = steel().tvbrdf.original
    monkeypatch.setenv("TVBRDF_WORKER", str(folder / "missing.py"))
    session.stop_worker()
    with pytest.raises(RuntimeError, match="There is no worker at"):
        age()
    assert steel().tvbrdf.original == original
    assert image_folders(steel()) == {"Steel"}


def test_what_nobody_foresaw_is_one_sentence_and_a_log(folder: Path, monkeypatch):
    def broken(*_arguments: object, **_settings: object) -> None:
        raise KeyError("what was it")

    monkeypatch.setattr("tvbrdf.tvbrdf_addon.session.plan", broken)
    monkeypatch.setattr("tvbrdf.tvbrdf_addon.operators.revert", broken)
    monkeypatch.setattr("tvbrdf.tvbrdf_addon.operators.is_aged", lambda _material: True)
    for operator in (bpy.ops.tvbrdf.age_material, bpy.ops.tvbrdf.revert):
        with pytest.raises(RuntimeError, match="This should not happen") as caught:
            operator(material="Steel")
        said = str(caught.value)
        assert "Traceback" not in said
        log = Path(re.search(r"send the file (\S+)\.", said)[1])
        assert "KeyError: 'what was it'" in log.read_text().rpartition("Traceback")[2]


def test_a_worker_that_fails_in_ways_nobody_foresaw_is_logged(folder: Path, monkeypatch):
    (folder / "worker.py").write_text("raise SystemError('what was it')")
    monkeypatch.setenv("TVBRDF_WORKER", str(folder / "worker.py"))
    with pytest.raises(RuntimeError, match="what was it") as caught:
        age()
    assert "Traceback" not in str(caught.value)
    log = Path(re.search(r"send the file (\S+)\.", str(caught.value))[1])
    assert "SystemError: what was it" in log.read_text().rpartition("Traceback")[2]


@pytest.mark.parametrize("path", ["//worker.py", "worker.py"])
def test_a_worker_beside_the_blend_is_not_run(folder: Path, monkeypatch, path: str):
    (folder / "worker.py").write_text(f"open({str(folder / 'it_ran')!r}, 'w')")
    monkeypatch.chdir(folder)
    launch = preferences.launch()
    monkeypatch.setattr(preferences, "_preferences", lambda: Preferences(path))
    assert preferences.launch() != launch
    with pytest.raises(RuntimeError, match="is not the whole path of a worker"):
        age()
    assert not (folder / "it_ran").exists()


class Preferences(NamedTuple):
    worker_python: str
    models_folder: str = ""
    idle_minutes: int = 10
    keep_gigabytes: float = 2.0


def stepped(until: Callable[[Run], bool] = lambda run: run.fraction > 0) -> Run:
    """A run that has come so far, as the modal operator does it."""
    run = session.begin(steel(), bpy.context.scene)
    while not until(run):
        assert run.step()
    return run


@pytest.fixture
def slow(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run long enough to be disturbed."""
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "30")
    steel().tvbrdf.steps = 600
    return folder


def ending(run: Run, pause: float = 0.0) -> Exception:
    try:
        while run.step():
            time.sleep(pause)
    except Exception as error:
        session.finish(run, icon="ERROR", sentences=(str(error),))
        return error
    pytest.fail("the run went through")


def test_there_is_one_run_at_a_time(slow: Path):
    run = stepped()
    assert not bpy.ops.tvbrdf.age_material.poll()
    with pytest.raises(SettingsError, match="Steel is being aged"):
        session.begin(steel(), bpy.context.scene)
    bpy.ops.tvbrdf.cancel()
    assert ending(run).code == "cancelled"
    assert bpy.ops.tvbrdf.age_material.poll()
    assert left_behind(slow) == []
    assert not is_aged(steel())


def test_cancel_is_not_behind_all_that_the_worker_says(slow: Path):
    """Steps are taken ten times a second; here the worker speaks ten times as often."""
    steel().tvbrdf.steps = 3000
    run = stepped()
    asked = time.monotonic()
    for _ in range(10):
        assert run.step()
        time.sleep(0.1)
    run.cancel()
    assert ending(run, pause=0.1).code == "cancelled"
    assert time.monotonic() - asked < 3


def test_renaming_during_a_run(folder: Path):
    run = stepped()
    steel().name = "Iron"
    while run.step():
        pass
    session.finish(run, icon="NONE", sentences=())
    assert is_aged(bpy.data.materials["Iron"])


def test_deleting_during_a_run(slow: Path):
    run = stepped()
    bpy.data.materials.remove(steel())
    error = ending(run)
    assert isinstance(error, RunEndedError)
    assert "Steel was deleted" in error.message


def test_loading_during_a_run(slow: Path):
    run = stepped()
    bpy.ops.wm.open_mainfile(filepath=str(slow / "file.blend"))
    assert "another file" in str(ending(run))
    assert not is_aged(steel())


def test_undo_during_a_run(slow: Path):
    bpy.ops.ed.undo_push(message="first")
    steel().tvbrdf.seed = 3
    bpy.ops.ed.undo_push(message="second")
    run = stepped()
    bpy.ops.ed.undo()
    assert "undo" in str(ending(run))
    assert not is_aged(steel())


def test_killing_the_worker_during_a_run(slow: Path):
    run = stepped()
    os.kill(session._warm_worker().pid, signal.SIGKILL)
    assert "killed by signal 9" in str(ending(run))
    assert left_behind(slow) == []
    assert not is_aged(steel())


def test_the_bar_goes_on_while_the_worker_starts(slow: Path, monkeypatch):
    run = stepped(lambda run: run.stage == "Starting the worker")
    assert run.fraction == 0 and 0.01 <= run.progress < 0.1
    monkeypatch.setattr("time.monotonic", lambda: run._began + 2.0)
    later = run.progress
    assert later >= 0.02
    monkeypatch.setattr("time.monotonic", lambda: run._began + 60.0)
    assert later < run.progress <= 0.1
    run.fraction, run.turn = 0.5, (2, 4)
    assert run.progress == pytest.approx(0.375)
    run.cancel()
    ending(run)


def test_time_left_is_a_guess_from_the_pace(slow: Path, monkeypatch):
    run = stepped(lambda run: run.fraction > 0.06)
    monkeypatch.setattr("time.monotonic", lambda: run._computing_since + 12.0)
    run.fraction = 0.25
    assert run.seconds_left == pytest.approx(36.0)
    run.cancel()
    ending(run)
