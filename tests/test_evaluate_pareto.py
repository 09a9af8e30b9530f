"""The report `evaluate pareto`: its points, its fronts, its figures, and that it resumes."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model_runtime.age import AgeRequest
from model_runtime.errors import UsageError
from tests.saved_figures import points_of, rounded, saved_figures
from training.__main__ import main
from training.evaluation.bench.aging import age_silently
from training.evaluation.bench.kept import kept_json
from training.evaluation.pareto.chart import draw_chart
from training.evaluation.pareto.evaluate import evaluate_pareto
from training.evaluation.pareto.exact import compared, exact_texels, interpolated
from training.evaluation.pareto.report import tables
from training.evaluation.pareto.results import better_than
from training.evaluation.pareto.settings import SETTINGS, setting
from training.evaluation.synthesis.sources import Effort
from training.ntm import NTMConfig

pytestmark = pytest.mark.usefixtures("one_thread")

MATERIAL = "PaintedMetal007"
TINY = Effort(NTMConfig(iterations=2, batch=8), 24, NTMConfig(iterations=2, batch=8), 2)
MEASURED = (
    *(
        "draft",
        "balanced",
        "draft, live",
        "balanced, live",
        "affine",
        "every 3rd frame",
        "aged every 3rd frame",
        "sparse",
    ),
    *("size / 2", "uncompressed", "latents", "latents, m = 258", "latents, fitted"),
)


def evaluate(data: Path, output: Path):
    return evaluate_pareto(
        data,
        output,
        pixels=6,
        size=32,
        frames=6,
        texels=200,
        latents_texels=4,
        materials=(MATERIAL,),
        settings=[setting(name) for name in MEASURED],
        effort=TINY,
        paper_texels=1,
    )


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pareto ü")


@pytest.fixture(scope="module")
def report(data_folder: Path, output: Path):
    return evaluate(data_folder, output)


@pytest.fixture(scope="module")
def points(report, output: Path) -> dict[str, dict[str, Any]]:
    """`points` of `pareto.json`, by name."""
    stored = json.loads((output / "pareto.json").read_text(encoding="utf-8"))
    return {point["name"]: point for point in stored["points"]}


@pytest.mark.slow
class TestReport:
    def test_every_setting_and_rival_has_its_point(self, points):
        assert set(points) == {*MEASURED, "exact", "latents exact", "stt", "staf", "paper"}
        for name in MEASURED:
            point = points[name]
            assert point["seconds"]["core"] > 0 and point["seconds"]["wall"] > 0
            assert {"read", "onset", "model", "write"} <= set(point["seconds"]["stages"])
            assert point["psnr"]["worst_material"] == MATERIAL
            assert point["psnr"]["worst_frame"] <= point["psnr"]["worst"] <= 100
            assert point["bytes"] > 0
            assert not point["extrapolated"]

    def test_what_was_worked_out_from_fewer_texels_is_marked(self, points):
        for name in ("exact", "latents exact", "stt", "staf", "paper"):
            assert points[name]["extrapolated"]
        assert points["paper"]["truth"]["extrapolated"]
        assert not points["balanced"]["truth"]["extrapolated"]

    def test_the_fronts_are_those_of_the_numbers(self, points):
        for panel in ("whole", "latents"):
            shown = [p for p in points.values() if p["panel"] == panel]
            for point in shown:
                better = [
                    other
                    for other in shown
                    if other["seconds"]["core"] < point["seconds"]["core"]
                    and other["psnr"]["mean"] > point["psnr"]["mean"]
                ]
                assert not (point["front"] and better)
            assert any(point["front"] for point in shown)
        assert points["exact"]["front"]

    def test_knobs_cost_and_save_what_they_must(self, points):
        psnr = {name: point["psnr"]["mean"] for name, point in points.items()}
        assert psnr["balanced"] > 45
        assert psnr["uncompressed"] == psnr["balanced"]
        assert psnr["affine"] < psnr["balanced"]
        assert points["every 3rd frame"]["frames_written"] == 2
        assert points["size / 2"]["bytes"] < points["balanced"]["bytes"]
        assert points["balanced"]["bytes"] < points["uncompressed"]["bytes"]
        assert points["balanced"]["truth"]["psnr"]["s1_a0.8_b0.1"] > 60
        assert points["sparse"]["truth"] is None
        for quality in ("draft", "balanced"):
            live = points[f"{quality}, live"]
            assert live["frames_written"] == 0 and live["truth"] is None
            assert live["psnr"]["worst_frame"] >= 38
            assert live["bytes"] < points[quality]["bytes"]

    def test_the_issue_s_figures_are_all_there(self, report, output: Path):
        stored = json.loads((output / "pareto.json").read_text(encoding="utf-8"))
        names = " ".join(figure["name"] for figure in stored["figures"])
        for part in ("draft", "balanced", "lstm_latents", "memory", "growth", "warm worker"):
            assert part in names
        for part in ("balanced, live, 32 x 32", "draft, live, worst frame", "live, 128 x 128"):
            assert part in names
        assert "same EXRs from memory" in names
        for figure in stored["figures"]:
            assert figure["asked"] and figure["measured"] and isinstance(figure["met"], bool)
        for saving in ("palette", "sparse", "ZIP", "uniform"):
            assert any(saving in each["name"] for each in stored["savings"])
        assert stored["machine"]["highest_load"] >= 0
        assert all(f"| {name} |" in tables(report) for name in MEASURED)

    def test_further_lobes_cost_and_gain(self, report):
        every = [row for row in report.lobes if row["material"] == "ilm_l3_37_dark_green_rgb"]
        one, two, three = every
        assert [row["lobes"] for row in every] == [1, 2, 3]
        assert one["core"] < two["core"] < three["core"]
        assert two["psnr"] > one["psnr"] + 4
        assert sum(row["chosen"] for row in report.lobes) == len(report.lobes) / 3
        (chosen,) = (row for row in every if row["chosen"])
        assert f"**{chosen['psnr']:.1f} ({chosen['core']:.2f})**" in tables(report)

    def test_the_chart_shows_every_point(self, report, tmp_path: Path):
        with saved_figures() as figures:
            draw_chart(report, tmp_path / "pareto.png")
        shown = points_of(figures["pareto.png"])
        for point in report.points:
            if point.mean is not None:
                assert (rounded(point.core), rounded(point.mean)) in shown, point.name
            if point.truth_mean is not None:
                truth = (rounded(point.truth.seconds), rounded(point.truth_mean))
                assert truth in shown, point.name
        assert sum(point.mean is not None for point in report.points) > len(report.points) / 2
        assert any(point.truth_mean is not None for point in report.points)

    def test_what_was_measured_is_used_again(self, report, data_folder: Path, output: Path):
        """All but what is damaged, which is measured again."""
        kept = {path: path.stat().st_mtime_ns for path in (output / "kept").iterdir()}
        damaged = output / "kept" / f"run_affine_{MATERIAL}.json"
        damaged.write_text(damaged.read_text()[:-9])
        again = evaluate(data_folder, output)
        now = {path: path.stat().st_mtime_ns for path in (output / "kept").iterdir()}
        assert {path for path in now if now[path] != kept.get(path)} == {damaged}
        psnr = {point.name: point.psnr for point in report.points}
        assert {point.name: point.psnr for point in again.points} == psnr


class TestExact:
    def test_quality_exact_is_as_near_as_halves_and_fewer_texels_allow(
        self, data_folder: Path, tmp_path: Path
    ):
        """The command itself, on a whole map, against what is modeled of some of its texels."""
        material = data_folder / "pbr" / MATERIAL
        found = exact_texels(
            material, "rust", "auto", size=16, frames=6, texels=50, folder=tmp_path / "kept"
        )
        assert found.rows.shape == (50,) and found.states.shape == (5, 50, 7)
        request = AgeRequest(material, "rust", tmp_path / "out", frames=6, size=16, quality="exact")
        assert age_silently(request)["temporal_model"] == found.rung
        assert min(found.psnr(tmp_path / "out")) == pytest.approx(100)

    def test_fewer_frames_show_the_nearest(self, data_folder: Path, tmp_path: Path):
        material = data_folder / "pbr" / MATERIAL
        found = exact_texels(
            material, "rust", "auto", size=16, frames=5, texels=50, folder=tmp_path
        )
        request = AgeRequest(material, "rust", tmp_path / "out", frames=2, size=16, quality="exact")
        age_silently(request)
        psnr = found.psnr(tmp_path / "out")
        assert psnr[-1] == pytest.approx(100)
        assert max(psnr[:-1]) < 60

    def test_frames_are_spread_and_the_first_is_left_out(self):
        assert compared(36) == [4, 8, 12, 16, 19, 23, 27, 31, 35]
        assert compared(3) == [1, 2]

    def test_texels_of_a_map_as_large_are_its_own(self):
        pixels = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)
        rows = np.array([0, 8, 34])
        np.testing.assert_array_equal(
            interpolated(pixels, (5, 7), rows), pixels.reshape(35, 3)[rows]
        )

    def test_a_ramp_stays_a_ramp_on_a_smaller_map(self):
        """Column x of 8 has its center at (x + 0.5) / 8: between those of 4 columns."""
        ramp = np.broadcast_to((np.arange(4, dtype=np.float32) + 0.5) / 4, (2, 4))
        inner = np.arange(1, 7)
        np.testing.assert_allclose(interpolated(ramp, (4, 8), inner), (inner + 0.5) / 8, rtol=1e-6)


class TestFront:
    def test_by_hand(self):
        seconds, psnr = [1, 2, 3, 2.5, 1], [30, 40, 50, 35, 29]
        assert better_than(seconds, psnr) == [[], [], [], [1], [0]]

    def test_what_noise_may_have_done_takes_nobody_off(self):
        assert better_than([1, 1.02, 1.1], [40, 40, 40.05]) == [[], [], []]
        assert better_than([1, 1.1], [40, 40]) == [[], [0]]

    @given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=12))
    def test_for_every_point_off_it_one_on_it_is_as_good(self, pairs):
        better = better_than(*zip(*pairs, strict=True), noise=(0.0, 0.0))
        front = [pair for pair, others in zip(pairs, better, strict=True) if not others]
        for cost, gain in pairs:
            assert any(c <= cost and g >= gain for c, g in front)


def test_each_setting_turns_one_knob():
    """All but the qualities; `checked` goes with the width of the cells, which it would change."""
    assert len({each.name for each in SETTINGS}) == len(SETTINGS)
    for each in SETTINGS:
        base = setting("balanced" if each.panel == "whole" else "latents")
        if each.name == "draft, live":
            base = setting("draft")
        turned = [
            *(name for name in vars(base) if getattr(each, name) != getattr(base, name)),
            *(
                name
                for name, value in vars(base.effort).items()
                if vars(each.effort)[name] != value
            ),
        ]
        knobs = set(turned) - {"name", "knob", "effort", "checked", "most"}
        assert len(knobs) <= 1 or each.name == "draft", each.name


def test_kept_json_is_made_again_only_where_it_must(tmp_path: Path):
    made = []

    def make() -> int:
        made.append(1)
        return len(made)

    path = tmp_path / "a" / "value.json"
    assert [kept_json(path, of, make) for of in ("x", "x", "y", "y")] == [1, 1, 2, 2]
    path.write_text("{")
    assert kept_json(path, "y", make) == 3


def test_what_does_not_exist_is_said(data_folder: Path, tmp_path: Path, capsys, monkeypatch):
    with pytest.raises(UsageError, match="'Wood'"):
        evaluate_pareto(data_folder, tmp_path, materials=("Wood",))
    words = ("training", "evaluate", "pareto", "--methods", "ours", "--output", str(tmp_path))
    monkeypatch.setattr(sys, "argv", list(words))
    assert main() == 2
    assert "--methods" in capsys.readouterr().err
