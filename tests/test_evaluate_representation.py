"""The report `evaluate representation`: what is in it, what is left out, and that it says so."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from torch import Tensor

from model_runtime.errors import ModelFileError, UsageError
from model_runtime.model_files.weights import save_model
from tests.saved_figures import points_of, rounded, saved_figures, texts_of
from training.baselines.encoders import build_encoder
from training.evaluation.bench.charts import LOOKS
from training.evaluation.representation.evaluate import (
    Curve,
    evaluate_representation,
    score,
    truth,
)
from training.evaluation.representation.methods import (
    METHODS,
    Budget,
    EncoderMethod,
    load_methods,
)
from training.evaluation.representation.report import main_table
from training.evaluation.representation.results import Cell, Report
from training.evaluation.representation.sets import BAD_FITS, FRAMES, SETS, UNIFORM, material_sets
from training.metric.sphere import MAPS, Sphere

TINY = Budget(uniform=20, texel=5)
FIELDS = {
    "sets",
    "parameters",
    "latent_dims",
    "encode_ms",
    "refine_ms",
    "decode_us_per_sample",
    "train_minutes",
    "train_iterations",
    "samples",
    "texel_samples",
    "curve",
    "progress",
    "properties",
}
CHARTS = {
    "representation_materials.png": lambda report: scores(report, UNIFORM),
    "representation_frames.png": lambda report: scores(report, FRAMES),
    "representation_speed.png": lambda report: {
        point.encode_ms
        for method in report.methods.values()
        for point in method.curve
        if point.samples == method.cost.samples
    },
    "representation_stability.png": lambda report: {
        value
        for method in report.methods.values()
        if method.properties
        for damage in method.properties["stability"].values()
        for value in damage["mean"]
        if value is not None
    },
}
"""The numbers that a chart of the report has to show."""
PAGES = ("spheres_best.png", "spheres_median.png", "spheres_worst.png")


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("report ü")


@pytest.fixture(scope="module")
def made(data_folder: Path, output: Path) -> tuple[Report, dict[str, Figure]]:
    """A small report of two methods, and its figures."""
    with saved_figures() as figures:
        report = evaluate_representation(
            data_folder,
            output,
            pixels=8,
            methods=("ours", "nbrdf"),
            limit=3,
            budget=TINY,
            curve=Curve(materials=1, pixels=6),
        )
    return report, figures


@pytest.fixture(scope="module")
def report(made: tuple[Report, dict[str, Figure]]) -> Report:
    return made[0]


@pytest.fixture(scope="module")
def figures(made: tuple[Report, dict[str, Figure]]) -> dict[str, Figure]:
    return made[1]


def scores(report: Report, sets: Sequence[str]) -> set[float]:
    """In dB, of every method on every material of the sets."""
    cells = [each for method in report.methods.values() for each in method.cells.items()]
    return {value for name, cell in cells if name in sets for value in cell.materials.values()}


@pytest.fixture
def sphere(data_folder: Path) -> Sphere:
    return Sphere.load(data_folder / "hdri", pixels=10)


def test_the_file_holds_every_method_set_and_number(report: Report, output: Path):
    stored = json.loads((output / "representation.json").read_text())
    assert stored == json.loads(json.dumps(report.json()))
    assert set(stored["methods"]) == {"ours", "nbrdf"}
    for method in stored["methods"].values():
        assert set(method) == FIELDS
        for scores in method["sets"].values():
            assert scores["min"] <= scores["p5"] <= max(scores["materials"].values())
            assert scores["n"] == len(scores["materials"])
        assert method["encode_ms"] > 0 and method["decode_us_per_sample"] > 0
        assert all(point["mean"] for point in method["curve"])
    ours = stored["methods"]["ours"]["sets"]
    assert tuple(ours) == SETS
    assert [ours[name]["n"] for name in SETS] == [3, 3, 3, 2, 3, 3, 5, 5]
    assert list(ours["tvbtf45"]["materials"])[1] == "t = 0.25"


def test_cells_in_which_a_method_is_the_data_are_left_out(report: Report, output: Path):
    assert set(report.methods["nbrdf"].cells) == set(SETS) - {"merl_seen", "merl_held_out", "rgl"}
    assert main_table(report).count("(the data)") == 3
    assert "(the data)" in (output / "representation.md").read_text(encoding="utf-8")
    assert report.methods["nbrdf"].cost.parameters == 675


def test_a_bad_fit_is_listed_and_is_never_the_worst():
    cell = Cell({"satin_white_rgb": 30.0, "chm_orange_rgb": 10.0, "paper_blue_rgb": 50.0}).json()
    assert (cell["mean"], cell["min"], cell["n"]) == (30.0, 30.0, 3)
    assert cell["p5"] == 31.0
    assert cell["materials"]["chm_orange_rgb"] == 10.0


@pytest.mark.parametrize("name", CHARTS)
def test_charts_show_the_report_s_values(report: Report, figures: dict[str, Figure], name: str):
    expected = {rounded(value) for value in CHARTS[name](report)}
    assert expected
    assert expected <= {number for point in points_of(figures[name]) for number in point}


@pytest.mark.parametrize("name", PAGES)
def test_spheres_are_shown_with_their_scores(report: Report, figures: dict[str, Figure], name: str):
    """Of three materials a set, each page has room for ten."""
    values = sorted(
        value
        for set_name in UNIFORM
        for material, value in report.methods["ours"].cells[set_name].materials.items()
        if material not in BAD_FITS
    )
    middle = (len(values) - 10) // 2
    chosen = {PAGES[0]: values[-10:], PAGES[1]: values[middle : middle + 10], PAGES[2]: values[:10]}
    assert {f"{value:.1f} dB" for value in chosen[name]} <= set(texts_of(figures[name]))


def test_a_walk_between_two_materials_leaves_the_first_and_nears_the_second(figures):
    for row in np.array(figures["interpolation.png"].axes).reshape(2, -1):
        first, *walk, last = (np.asarray(ax.images[0].get_array(), float) for ax in row)
        from_first, from_last = (
            [float(np.square(step - end).mean()) for step in walk] for end in (first, last)
        )
        assert from_first[0] < from_first[-1] and from_last[0] > from_last[-1]
        assert from_first[0] < from_last[0] and from_first[-1] > from_last[-1]


def test_the_page_shows_every_image(figures: dict[str, Figure], output: Path):
    text = (output / "representation.md").read_text(encoding="utf-8")
    assert {*CHARTS, *PAGES, "interpolation.png"} <= set(figures)
    for name in figures:
        assert f"({name})" in text
        assert (output / name).is_file()


def test_what_was_learned_and_rendered_is_used_again(
    report: Report, data_folder: Path, output: Path
):
    """All but what is damaged, which is made again."""
    kept = {path: path.stat().st_mtime_ns for path in (output / "kept").iterdir()}
    networks = output / "kept" / "networks_disney_0_16200_20.safetensors"
    rendered = output / "kept" / "nbrdf_disney_0.safetensors"
    for path in (networks, rendered):
        path.write_bytes(path.read_bytes()[:-50])
    again = evaluate_representation(
        data_folder,
        output,
        pixels=8,
        methods=("nbrdf",),
        limit=3,
        budget=TINY,
        curve=Curve(materials=1, pixels=6),
    )
    now = {path: path.stat().st_mtime_ns for path in (output / "kept").iterdir()}
    assert {path for path in kept if now[path] != kept[path]} == {networks, rendered}
    assert again.methods["nbrdf"].cells == report.methods["nbrdf"].cells


def test_a_changed_method_is_rendered_again(sphere: Sphere, data_folder: Path, tmp_path: Path):
    (materials,) = material_sets(data_folder, sphere.inside, wanted=("bsdf",), limit=1)["bsdf"]
    radiance = truth(sphere, materials)
    path = tmp_path / "kept.safetensors"
    exact = score(sphere, materials, radiance, materials.evaluate, path)
    written = path.stat().st_mtime_ns
    again = score(sphere, materials, radiance, materials.evaluate, path)
    assert path.stat().st_mtime_ns == written
    (name,) = materials.names
    assert again[name].score == exact[name].score
    darker = score(sphere, materials, radiance, lambda *at: 0.5 * materials.evaluate(*at), path)
    assert exact[name].score == pytest.approx(100)
    assert darker[name].score < 30


def test_trained_rivals_are_read_from_their_files(data_folder: Path, tmp_path: Path):
    card = {"trained": {"minutes": 60.0, "iterations": 7}}
    rivals = ("paper", "brdfnps", "deepbrdf", "hyperbrdf")
    for name in rivals:
        model = build_encoder(name)
        save_model(
            tmp_path / f"{name}.safetensors",
            model.state_dict(),
            {"name": name, "title": name, **card},
            kind="encoder",
        )
    methods = load_methods(None, weights=tmp_path, cache=tmp_path, budget=TINY)
    assert list(methods) == ["ours", *rivals, "nbrdf"]
    sphere = Sphere.load(data_folder / "hdri", pixels=4)
    (materials,) = material_sets(data_folder, sphere.inside, wanted=("disney",), limit=1)["disney"]
    for name in rivals:
        method = methods[name]
        held = method.hold(materials, method.settings()[0])
        angles = sphere.angles[0, :50]
        assert held.evaluate(torch.tensor([0]), angles).shape == (1, 50, 3)
        read = len(method.model.sample_angles(16)) if isinstance(method, EncoderMethod) else 0
        assert method.point([held], method.settings()[0])[0] == read


def test_missing_weights_and_unknown_names_are_said(tmp_path: Path, data_folder: Path):
    with pytest.raises(ModelFileError, match=r"'paper'.*--config paper-short --minutes 60"):
        load_methods(None, weights=tmp_path, cache=tmp_path, budget=TINY)
    with pytest.raises(ModelFileError, match="'paper_long'"):
        load_methods(("paper_long",), weights=tmp_path, cache=tmp_path, budget=TINY)
    with pytest.raises(UsageError, match="'papers'"):
        evaluate_representation(data_folder, tmp_path, methods=("papers",))
    with pytest.raises(UsageError, match="'merl'"):
        evaluate_representation(data_folder, tmp_path, methods=("ours",), sets=("merl",))


def test_colors_and_markers_of_methods_differ():
    assert len({LOOKS[name].color for name in METHODS}) == len(METHODS)
    assert len({LOOKS[name].marker for name in METHODS}) == len(METHODS)


def test_a_texture_of_one_material_looks_like_that_material(sphere: Sphere):
    def evaluate(rows: Tensor, angles: Tensor) -> Tensor:
        return 0.1 + angles.cos().abs().expand(len(rows), -1, -1)

    texels = torch.arange(len(sphere.angles)) % 3
    textured = sphere.render_textured(evaluate, texels)
    uniform = sphere.render(lambda angles: evaluate(torch.tensor([0]), angles))
    assert textured.shape == (1, len(MAPS), len(texels), 3)
    torch.testing.assert_close(textured, uniform, rtol=1e-5, atol=1e-6)


def test_half_a_turn_saves_half_the_work_and_changes_nothing(data_folder: Path):
    """Pixel by pixel, for an even and an odd number of pixels across."""

    def evaluate(angles: Tensor) -> Tensor:
        return torch.stack((angles.sin(), angles.cos().abs() + angles[:, 2:].abs()))

    for pixels in (6, 7):
        sphere = Sphere.load(data_folder / "hdri", pixels=pixels)
        count = len(sphere.angles)
        direct = torch.stack(
            [
                torch.einsum("ndc,edc->nec", evaluate(sphere.angles[p]), sphere.weights[:, p])
                for p in range(count)
            ],
            2,
        )
        torch.testing.assert_close(sphere.render(evaluate), direct, rtol=1e-4, atol=1e-5)


def test_frames_are_the_texture_at_five_times(data_folder: Path, sphere: Sphere):
    frames = material_sets(data_folder, sphere.inside, wanted=("tvbtf45",))["tvbtf45"]
    assert [frame.names for frame in frames] == [
        (f"t = {t}",) for t in ("0", "0.25", "0.5", "0.75", "1")
    ]
    for frame in frames:
        assert frame.texels is not None
        assert len(frame.texels) == len(sphere.angles)
        assert frame.texels.max() == frame.n - 1 == 8  # 3 x 3 blocks of 4 x 4 pixels
    away = torch.tensor([[0.5, 0.3, 1.0]])
    assert not torch.allclose(frames[0].every(away), frames[4].every(away))


def test_a_limit_spreads_over_the_set(data_folder: Path, sphere: Sphere):
    groups = material_sets(data_folder, sphere.inside, wanted=("disney", "rgl"), limit=4)
    assert [name for group in groups["disney"] for name in group.names] == ["0", "33", "66", "99"]
    whole = material_sets(data_folder, sphere.inside, wanted=("disney",))["disney"]
    angles = sphere.angles[0, :20]
    chosen = torch.cat([group.every(angles) for group in groups["disney"]])
    every = torch.cat([group.every(angles) for group in whole])
    torch.testing.assert_close(chosen, every[[0, 33, 66, 99]])
    renamed = replace(groups["rgl"][0], key="other")
    torch.testing.assert_close(renamed.every(angles), groups["rgl"][0].every(angles))
