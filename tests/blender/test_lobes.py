"""Measurements of several lobes in Blender: Cycles shows the formula, from every side."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
import torch

from model_runtime.brdf import lobes
from model_runtime.brdf.half_angle import from_directions
from model_runtime.channels import LOBE, lobe_maps
from model_runtime.contract import AgeRequest
from model_runtime.live.files import read_live
from tests.blender.aged_cases import bind, settled
from tests.blender.material_cases import (
    add_sun,
    new_material,
    plane,
    procedural,
    render,
    view_from_above,
    write_result,
)
from training.evaluation.bench.aging import age_silently
from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
from tvbrdf.tvbrdf_addon.material.binding.freeze_live import freeze_live
from tvbrdf.tvbrdf_addon.material.nodes.revert import revert
from tvbrdf.tvbrdf_addon.material.nodes.surface import find_principled

pytestmark = pytest.mark.usefixtures("empty_scene")

SUN = 4.0
FELT = (
    *((0.1, 0.05, 0.02), (0.05, 0.04, 0.03), 0.2),
    *((0.17, 0.05, 0.0), (0.02, 0.3, 0.6), 0.6, 0.3),
    *((0.2, 0.3, 0.5), (0.2, 0.3, 0.5), 0.9, 0.1),
)
"""Kd, Ks and alpha, and of two further lobes color, edge, weight and alpha; the first turns."""

NAMES = ("kd", "ks", "alpha",
         *(f"{n}_{m}" for n in ("second", "third") for m in LOBE))  # fmt: skip

VIEWS = ((0.0, 25.0), (40.0, 50.0), (65.0, 60.0))
"""Degrees between normal and eye, and normal and light on its other side; the last one is where the
further lobes rise."""

NEARER = (30.0, 30.0)
"""Where a rough first lobe is Cycles' too: farther out its masking, the paper's, is another."""


def sides_of(obj: bpy.types.Object, eye: float, light: float) -> None:
    """Turns a plane that is looked at from above, and puts a sun there."""
    for old in [each for each in bpy.data.objects if each.type == "LIGHT"]:
        bpy.data.objects.remove(old)
    obj.rotation_euler = (0, math.radians(eye), 0)
    away = math.radians(eye + light)
    add_sun((-math.sin(away), 0.0, -math.cos(away)), SUN)


def radiance(numbers: np.ndarray, eye: float, light: float) -> np.ndarray:
    """What `sides_of` shows of lobes [C + 8 K]: [3]."""
    at, beyond = math.radians(eye), math.radians(light)
    wo = torch.tensor([[-math.sin(at), 0, math.cos(at)]], dtype=torch.float64)
    wi = torch.tensor([[math.sin(beyond), 0, math.cos(beyond)]], dtype=torch.float64)
    f = lobes.evaluate(torch.from_numpy(numbers.astype(np.float64))[None], from_directions(wi, wo))
    return f[0, 0].numpy() * SUN * math.cos(beyond)


def shown(tmp_path: Path, frame: int) -> np.ndarray:
    """The middle of the picture."""
    return render(tmp_path / "shown.exr", frame, size=15, samples=16)[6:9, 6:9].mean((0, 1))


def written(
    folder: Path, count: int, *, size: int = 1, parts: tuple[float, ...] = (0.5, 1.0)
) -> Path:
    """A result of `count` lobes: `parts` of `FELT`, by default half of everything and then all."""
    maps = {
        name: [np.full((size, size, *np.shape(value)), part * np.array(value)) for part in parts]
        for name, value in zip(NAMES[: 4 * count - 1], FELT, strict=False)
        if name != "third_edge"
    }
    write_result(folder, "torrance-sparrow", maps)
    report = folder / "aged.json"
    report.write_text(json.dumps({**json.loads(report.read_text()), "lobes": count}))
    return folder


def test_cycles_shows_every_lobe_from_every_side(tmp_path: Path):
    material = new_material()
    material.tvbrdf.onset = "none"
    obj = plane(material)
    view_from_above()
    shown(tmp_path, 1)  # whose image stays in the file
    before = settled(material)
    bind(material, obj, written(tmp_path / "aged", 3), tmp_path, span=(1, 2))
    numbers = np.concatenate([np.ravel(each) for each in FELT])
    for eye, light in VIEWS:
        sides_of(obj, eye, light)
        np.testing.assert_allclose(shown(tmp_path, 2), radiance(numbers, eye, light), rtol=0.01)
    mixes = [node.name for node in material.node_tree.nodes if node.type in ("MIX", "LAYER_WEIGHT")]
    assert sorted(mixes) == ["Lobe 2, Edge", "Lobe 2, Facing"]
    obj.rotation_euler = (0, 0, 0)
    revert(material)
    assert settled(material) == before


def test_our_lobes_are_not_the_artists(tmp_path: Path):
    material = new_material()
    obj = plane(material)
    bind(material, obj, written(tmp_path / "aged", 2), tmp_path, span=(1, 2))
    from tvbrdf.tvbrdf_addon.errors import MaterialError

    with pytest.raises(MaterialError):
        find_principled(material)


@pytest.fixture(scope="module")
def live_felt(data_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A measured felt that rusts, live."""
    folder = tmp_path_factory.mktemp("felt") / "live"
    felt = data_folder / "bsdf" / "acrylic_felt_green_rgb.bsdf"
    age_silently(AgeRequest(felt, "rust", folder, size=16, binding="live", grain=0.0))
    assert json.loads((folder / "aged.json").read_text())["lobes"] > 1
    return folder


def states_of(folder: Path, time: float) -> np.ndarray:
    """The lobes [C + 8 K] of the texel in the middle."""
    maps = read_live(folder)
    assert maps.lobes is not None
    state = maps.at(np.zeros((16, 16, 7), np.float32), time)[8, 8]
    further = {name: np.ravel(each[8, 8]) for name, each in maps.further(time).items()}
    names = lobe_maps([True] * len(maps.lobes))
    lobes = [further.get(name, further[name.replace("edge", "color")]) for name in names]
    return np.concatenate((state[:6], np.square(state[6:]), *lobes))


@pytest.fixture
def at_once(live_felt: Path, tmp_path: Path) -> Path:
    """The same with one age all over, so that a picture has one color."""
    folder = tmp_path / "at_once"
    folder.mkdir()
    report = json.loads((live_felt / "aged.json").read_text())
    del report["files"]["timing"]
    for name in ("curves.exr", "lobes.exr", *report["files"]["coefficients"]):
        (folder / name).write_bytes((live_felt / name).read_bytes())
    (folder / "aged.json").write_text(json.dumps({**report, "height": False}))
    return folder


def test_a_live_measurement_is_what_was_measured_whatever_the_material_was(
    at_once: Path, tmp_path: Path
):
    material = new_material()
    procedural(material)
    obj = plane(material)
    view_from_above()
    shown(tmp_path, 1)  # whose image stays in the file
    before = settled(material)
    bind(material, obj, at_once, tmp_path, span=(1, 11))
    for sides in (VIEWS[0], NEARER):
        sides_of(obj, *sides)
        for frame in (1, 2, 11):
            truth = radiance(states_of(at_once, (frame - 1) / 10), *sides)
            print(
                "DBG",
                sides,
                frame,
                shown(tmp_path, frame),
                truth,
                states_of(at_once, (frame - 1) / 10).round(3),
            )
            continue
            np.testing.assert_allclose(shown(tmp_path, frame), truth, rtol=0.01)
    obj.rotation_euler = (0, 0, 0)
    revert(material)
    assert settled(material) == before


def test_frozen_it_keeps_its_lobes(at_once: Path, tmp_path: Path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    view_from_above()
    bind(material, obj, at_once, tmp_path, span=(1, 11))
    material.tvbrdf.folder, material.tvbrdf.size = str(at_once), 16
    bpy.context.scene.frame_set(2)
    freeze_live(material, obj, bpy.context.scene)
    sides_of(obj, *NEARER)
    truth = radiance(states_of(at_once, 0.1), *NEARER)
    np.testing.assert_allclose(shown(tmp_path, 1), truth, rtol=0.01)


def test_frozen_frames_keep_the_edge_that_they_turn_to(tmp_path: Path):
    """Of textures that never change there is one each: no fade from one into the other."""
    material = new_material()
    material.tvbrdf.onset = "none"
    obj = plane(material)
    view_from_above()
    folder = written(tmp_path / "aged", 2, size=4, parts=(1.0, 1.0))
    bind(material, obj, folder, tmp_path, span=(1, 2))
    freeze(material, 2)
    numbers = np.concatenate([np.ravel(each) for each in FELT[:7]])
    sides_of(obj, *VIEWS[1])
    np.testing.assert_allclose(shown(tmp_path, 2), radiance(numbers, *VIEWS[1]), rtol=0.01)


def test_curves_of_other_lobes_are_said(at_once: Path, tmp_path: Path):
    from tvbrdf.tvbrdf_addon.errors import MaterialError
    from tvbrdf.tvbrdf_addon.material.binding.live import read_lobes
    from tvbrdf.tvbrdf_addon.material.result import LiveFiles, read_result

    files = read_result(at_once)
    assert isinstance(files, LiveFiles)
    with pytest.raises(MaterialError, match="holds no lobes"):
        read_lobes(replace(files, lobes=files.lobes + 1))
