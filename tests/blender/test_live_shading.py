"""The shader of a live material against what the runtime says of every texel, at random ages."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import bpy
import numpy as np
import pytest

from model_runtime.brdf import principled
from model_runtime.live.files import read_live
from model_runtime.maps import PrincipledMaps, TorranceSparrowMaps
from tests.blender.live_cases import made_up_live, write_image
from tests.blender.live_shading import IOR, TINT, build, render_ages
from tests.blender.material_cases import pixels
from tests.blender.windowed import HERE, needs_window, run_in_window

SIZE = 32
AGES = (0.0, *np.random.default_rng(5).random(19).round(5).tolist())
DB = 60.0
OUTPUTS = {
    "principled": ("Base Color", "Metallic", "Roughness", "Specular IOR Level"),
    "principled-exact": ("Base Color", "Specular Tint", "Roughness"),
    "torrance-sparrow": ("Diffuse", "Specular", "Roughness"),
}
CASES = {
    "authored": ("principled", 5, True),
    "affine_alone": ("principled", 0, True),
    "at_once": ("principled", 2, False),
    "exact": ("principled-exact", 3, True),
    "torrance_sparrow": ("torrance-sparrow", 3, True),
}

IN_WINDOW = {"authored": AGES, "exact": AGES[:5], "torrance_sparrow": AGES[:5]}
EXACT = {"rtol": 0.0, "atol": 0.0}
HALF = {"rtol": 2.0**-10, "atol": 2.0**-22}
"""What EEVEE loses of anything: it renders half floats."""


def make_case(folder: Path, name: str) -> PrincipledMaps:
    kind, count, onset = CASES[name]
    made_up_live(folder / "live", kind, count=count, size=(SIZE, SIZE), onset=onset)
    rng = np.random.default_rng(2)
    base, numbers = (rng.random((SIZE, SIZE, 3), np.float32) for _ in range(2))
    # Metal is metal or not, mostly; and where it is not, colors fill their range.
    numbers[..., 0] = np.where(
        rng.random((SIZE, SIZE)) < 0.7, numbers[..., 0] > 0.5, numbers[..., 0]
    )
    base = np.square(base)
    write_image(folder / "authored.exr", base)
    write_image(folder / "numbers.exr", numbers)
    return as_authored(base, numbers)


def as_authored(
    base: np.ndarray,
    numbers: np.ndarray,
    ior: float = IOR,
    tint: tuple[float, float, float] = TINT,
) -> PrincipledMaps:
    metallic, roughness, level = (
        np.ascontiguousarray(each) for each in np.moveaxis(numbers, -1, 0)
    )
    size = metallic.shape
    return PrincipledMaps(
        base,
        metallic,
        level,
        roughness,
        np.full(size, ior, np.float32),
        np.broadcast_to(np.array(tint, np.float32), (*size, 3)),
    )


def wanted(folder: Path, authored: PrincipledMaps, age: float) -> TorranceSparrowMaps:
    start = principled.forward(authored)
    y0 = np.concatenate((start.kd, start.ks, authored.roughness[..., None]), -1)
    state = read_live(folder / "live").at(y0, age).astype(np.float32)
    return TorranceSparrowMaps(state[..., :3], state[..., 3:6], np.square(state[..., 6]))


def decibels(shown: np.ndarray, truth: np.ndarray) -> float:
    """Of square-rooted values."""
    error = np.sqrt(np.maximum(shown, 0)) - np.sqrt(np.maximum(truth, 0))
    return float(-10 * np.log10(np.maximum(np.mean(np.square(error)), 1e-16)))


def compare(
    folder: Path,
    authored: PrincipledMaps,
    kind: str,
    ages: Sequence[float],
    rounding: Mapping[str, float] = EXACT,
) -> dict[str, float]:
    """The worst age's dB of all that is seen; at age 0 `rounding` alone is lost."""
    found: dict[str, list[float]] = {}
    for k, age in enumerate(ages):
        truth = wanted(folder, authored, age)

        picture = pixels(folder / f"age_{k}.exr")
        tiles = [np.ascontiguousarray(each) for each in np.split(picture, len(OUTPUTS[kind]), 1)]
        shown = dict(zip(OUTPUTS[kind], tiles, strict=True))
        numbers = {name: np.ascontiguousarray(tile[..., 0]) for name, tile in shown.items()}
        now = {"roughness": (numbers["Roughness"], np.sqrt(truth.alpha))}
        if kind == "torrance-sparrow":
            now |= {"kd": (shown["Diffuse"], truth.kd), "ks": (shown["Specular"], truth.ks)}
        elif kind == "principled-exact":
            base, tint, _ = principled.exact(truth)
            now |= {"base": (shown["Base Color"], base), "tint": (shown["Specular Tint"], tint)}
        else:
            back = principled.read_back(truth, authored)
            sockets = PrincipledMaps(
                shown["Base Color"],
                numbers["Metallic"],
                numbers["Specular IOR Level"],
                numbers["Roughness"],
                authored.ior,
                authored.specular_tint,
            )
            seen, meant = principled.forward(sockets), principled.forward(back)
            now |= {
                "kd": (seen.kd, meant.kd),
                "ks": (seen.ks, meant.ks),
                "base": (sockets.base_color, back.base_color),
            }
            if age == 0:
                for field in ("base_color", "metallic", "specular", "roughness"):
                    seen, own = getattr(sockets, field), getattr(authored, field)
                    np.testing.assert_allclose(seen, own, **rounding)
        for name, pair in now.items():
            found.setdefault(name, []).append(decibels(*pair))
    return {name: min(each) for name, each in found.items()}


@pytest.mark.parametrize("name", CASES)
def test_cycles_shows_what_the_runtime_says(
    empty_scene: bpy.types.Scene, tmp_path: Path, name: str
):
    authored = make_case(tmp_path, name)
    material = build("tvbrdf", tmp_path)
    assert len(list(render_ages(material, AGES, "CYCLES", tmp_path))) == len(AGES)
    found = compare(tmp_path, authored, CASES[name][0], AGES)
    print(name, found)
    assert min(found.values()) >= DB, found


@pytest.mark.parametrize("ior", [1.0, 1.5, 3.0])
@pytest.mark.parametrize("tint", [(1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (1.0, 0.0, 0.5)])
def test_so_it_does_where_sockets_are_at_their_ends(
    empty_scene: bpy.types.Scene,
    tmp_path: Path,
    tint: tuple[float, float, float],
    ior: float,
):
    made_up_live(tmp_path / "live", count=3, size=(SIZE, SIZE))
    rng = np.random.default_rng(3)

    def pick(values: Sequence[float], channels: int) -> np.ndarray:
        return rng.choice(np.array(values, np.float32), (SIZE, SIZE, channels))

    gray, colored = pick((0, 0.02, 0.5, 1), 1), pick((0, 0.3, 1), 3)
    base = np.where(rng.random((SIZE, SIZE, 1)) < 0.5, gray, colored)
    ends = (pick((0, 0.5, 1), 1), pick((0, 0.01, 0.5, 1), 1), pick((0, 0.5, 1), 1))
    numbers = np.concatenate(ends, -1)
    write_image(tmp_path / "authored.exr", base)
    write_image(tmp_path / "numbers.exr", numbers)
    ages = AGES[:5]
    material = build("tvbrdf", tmp_path, ior, tint)
    assert len(list(render_ages(material, ages, "CYCLES", tmp_path))) == len(ages)
    authored = as_authored(base, numbers, ior, tint)
    found = compare(tmp_path, authored, "principled", ages)
    assert min(found.values()) >= DB, found


@pytest.mark.slow
@needs_window
def test_so_does_eevee(tmp_path: Path):
    authored = {}
    for name in IN_WINDOW:
        (tmp_path / "cases" / name).mkdir(parents=True)
        authored[name] = make_case(tmp_path / "cases" / name, name)
    (tmp_path / "ages.json").write_text(json.dumps(IN_WINDOW), encoding="utf-8")
    run_in_window(HERE / "windowed_live.py", tmp_path, HERE / "live_shading.py", seconds=900)
    for name, ages in IN_WINDOW.items():
        kind = CASES[name][0]
        found = compare(tmp_path / "cases" / name, authored[name], kind, ages, HALF)
        print(name, found)
        assert min(found.values()) >= DB, (name, found)
