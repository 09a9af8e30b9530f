"""The report `evaluate synthesis`: its cases, its methods, its numbers, and that it resumes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure

from model_runtime.brdf import torrance_sparrow
from model_runtime.errors import ModelFileError, UsageError
from model_runtime.model_files.weights import save_model
from model_runtime.representation import build
from tests.saved_figures import saved_figures, texts_of
from training.data.sequences import MixtureSequence, Sequence
from training.evaluation.bench.aging import texels_of
from training.evaluation.bench.charts import LOOKS
from training.evaluation.bench.spheres import TexturedSphere
from training.evaluation.synthesis import scoring as synthesis_scoring
from training.evaluation.synthesis.cases import CASES, GRID, make_cases, mixed_weights
from training.evaluation.synthesis.evaluate import evaluate_synthesis
from training.evaluation.synthesis.methods import METHODS, load_models, method_for
from training.evaluation.synthesis.report import PUBLISHED, averages_table
from training.evaluation.synthesis.results import CaseResult, Curve, SynthesisReport, averaged
from training.evaluation.synthesis.sources import Effort, SourceModels
from training.evaluation.synthesis.stage import Stage, as_parameters
from training.evaluation.synthesis.statistics import STATISTICS
from training.metric.sphere import psnr
from training.ntm import NTMConfig

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = Effort(NTMConfig(iterations=2, batch=8), 24, NTMConfig(iterations=2, batch=8), 2)
SIZE = 8
CELLS = ("s1_a0.6_b0.05", "s2_a1.0_b0.2")


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Untrained encoders: what is asked here does not depend on how good they are."""
    folder = tmp_path_factory.mktemp("weights ü")
    torch.manual_seed(0)
    for name in ("lobes", "paper", "brdfnps"):
        card = {"name": name, "title": name, "trained": {"minutes": 1.0, "iterations": 1}}
        tensors = build(name).state_dict()
        save_model(folder / f"{name}.safetensors", tensors, card, kind="encoder")
    return folder


@pytest.fixture(scope="module")
def sphere(data_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> TexturedSphere:
    kept = tmp_path_factory.mktemp("sphere")
    return TexturedSphere.load(data_folder / "hdri", pixels=SIZE, stride=3, folder=kept)


def evaluate(data: Path, output: Path, weights: Path, **options) -> SynthesisReport:
    options = {"cases": CELLS, "methods": ("ours", "stt", "constant")} | options
    return evaluate_synthesis(
        data,
        output,
        pixels=SIZE,
        stride=4,
        effort=TINY,
        encoder=weights / "lobes.safetensors",
        weights=weights,
        models=weights,
        **options,
    )


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("report ü")


@pytest.fixture(scope="module")
def report(data_folder: Path, output: Path, weights: Path) -> SynthesisReport:
    return evaluate(data_folder, output, weights)


def check_strip(figure: Figure) -> None:
    """Five frames; below the truth each method's picture, and below that its error and score."""
    texts = texts_of(figure)
    frames = [text for text in texts if text.startswith("frame ")]
    assert frames == [f"frame {k}" for k in (1, 9, 18, 27, 36)]
    assert {LOOKS[method].title for method in METHODS} <= set(texts)
    assert len([text for text in texts if text.endswith(" dB")]) == 4 * len(METHODS)
    pictures = [np.asarray(ax.images[0].get_array(), float) for ax in figure.axes]
    truth, *rows = (pictures[k : k + 5] for k in range(0, len(pictures), 5))
    for shown, errors in zip(rows[::2], rows[1::2], strict=True):
        for picture, error, right in zip(shown, errors, truth, strict=True):
            inside = np.isfinite(error)
            expected = np.abs(picture - right)[inside, :3].mean(-1)
            np.testing.assert_allclose(error[inside], expected, atol=2e-3)


class TestReport:
    def test_the_file_holds_every_case_method_and_number(self, report, output: Path):
        stored = json.loads((output / "synthesis.json").read_text())
        assert set(stored["cases"]) == set(CELLS)
        for case in stored["cases"].values():
            assert set(case["methods"]) == {"ours", "stt", "constant"}
            for numbers in case["methods"].values():
                assert set(numbers) == {"mean", "final", "min"}
                assert numbers["min"] <= numbers["final"] <= 100
                assert numbers["min"] <= numbers["mean"] <= 100
            assert len(case["chosen"]) == 4
        assert stored["train_minutes"]["ours"] >= 0
        assert stored["domains"] == {}, "no bundled models are in the folder"

    def test_the_affine_worlds_are_solved_by_what_the_product_chooses(self, report):
        for name in CELLS:
            case = report.cases[name]
            assert case.curves["ours"].json()["final"] > 60
            assert set(case.chosen.values()) == {"affine"}

    def test_the_page_has_both_tables_and_the_paper_s_own_figures(self, report, output: Path):
        text = (output / "synthesis.md").read_text(encoding="utf-8")
        assert text.count("published, other textures") == 10
        assert "table 1" in text and "table 2" in text

    def test_what_was_learned_and_scored_is_used_again(
        self, report, data_folder: Path, output: Path, weights: Path
    ):
        """All but what is damaged, which is made again, and comes out the same."""
        kept = {path: path.stat().st_mtime_ns for path in (output / "kept").iterdir()}
        damaged = output / "kept" / "s2_a10_b02_Wood049_stt.json"
        damaged.write_bytes(damaged.read_bytes()[:-50])
        again = evaluate(data_folder, output, weights)
        now = {path: path.stat().st_mtime_ns for path in (output / "kept").iterdir()}
        assert {path for path in now if now[path] != kept.get(path)} == {damaged}
        assert again.cases == report.cases
        assert again.train_minutes == report.train_minutes
        assert set(again.train_minutes) == {"ours"}

    @pytest.mark.slow
    def test_measured_and_spotted_cases_by_every_method(
        self, data_folder: Path, tmp_path: Path, weights: Path
    ):
        with saved_figures() as figures:
            report = evaluate(data_folder, tmp_path, weights, cases=("s3", "s4"), methods=METHODS)
        for name in ("s3", "s4"):
            case = report.cases[name].json()
            assert set(case["methods"]) == set(METHODS)
            assert {"paper", "brdfnps"} <= set(case["ceilings"])
            (strip,) = (figures[each] for each in figures if each.startswith(f"strip_{name}_"))
            check_strip(strip)
        assert set(report.cases["s3"].after_fit) == {"ours", *METHODS[-4:]}
        lobes = [set(getattr(report.cases["s3"], name)) for name in ("two_lobes", "three_lobes")]
        latents = "lstm_latents" in report.cases["s3"].chosen.values()
        assert lobes == [{"ours"} if latents else set()] * 2
        assert set(report.cases["s4"].true_onset) == {"ours", *METHODS[-4:]}
        assert set(report.cases["s4"].statistics) == set(STATISTICS)

    def test_what_does_not_exist_is_said(self, data_folder: Path, tmp_path: Path, weights: Path):
        with pytest.raises(UsageError, match="'s5'"):
            evaluate(data_folder, tmp_path, weights, cases=("s5",))
        with pytest.raises(UsageError, match="'papers'"):
            evaluate(data_folder, tmp_path, weights, methods=("papers",))
        with pytest.raises(ModelFileError, match=r"'paper'.*--config paper-short"):
            evaluate(data_folder, tmp_path, tmp_path, methods=("paper",))


def test_averages_are_over_the_cells_of_a_family():
    def case(mean: float, final: float) -> CaseResult:
        return CaseResult({"ours": Curve((0, 1, 2), (100.0, 2 * mean - final, final), 3)})

    cases = {
        "s1_a0.6_b0": case(40, 30),
        "s1_a1.0_b0.2": case(50, 20),
        "s2_a0.6_b0": case(60, 50),
        "s3": case(10, 10),
    }
    lines = averages_table(SynthesisReport(cases, {}, {}, 0.0)).splitlines()
    assert "| ours | 45.0 | 60.0 | 25.0 | 50.0 |" in lines
    assert lines[-1].endswith("| 38.5 | 40.3 | 30.9 | 36.2 |")


def test_every_cell_of_the_paper_s_tables_has_its_figure():
    assert len(GRID) == 30
    assert "s1_a0.6_b0.05" in GRID and "s2_a1.0_b0.2" in GRID
    assert CASES[-5:] == ("s3", "s4", "real_tvbtf45", "real_snowyground", "real_steelrusting")
    for row in PUBLISHED.values():
        assert len(row) == 16
        assert row[-1] == pytest.approx(np.mean(row[:-1]), abs=0.1)


class TestCases:
    def test_s1_and_s2_are_the_paper_s_at_the_last_frame(self, data_folder: Path):
        """t = 1, written out from section 4.3: delta and beta are in the target's first frame."""
        (first,) = list(make_cases(data_folder, ("s1_a0.6_b0.05",), size=SIZE))[:1]
        start, end = texels_of(first.target)[[0, -1]].unbind()
        torch.testing.assert_close(end[..., 0], start[..., 0] / 2.56)
        torch.testing.assert_close(end[..., 1], 0.6 + start[..., 1] / 1.6)
        torch.testing.assert_close(end[..., 2], start[..., 2] * 1.5 / 0.9 + 0.6)
        torch.testing.assert_close(end[..., 3:], start[..., 3:])
        (second,) = list(make_cases(data_folder, ("s2_a1.0_b0.2",), size=SIZE))[:1]
        start, end = texels_of(second.target)[[0, -1]].unbind()
        torch.testing.assert_close(
            end[..., :3], 0.1 * start[..., :3] + torch.tensor((0.9, 0.4, 0.15))
        )
        torch.testing.assert_close(end[..., 3:6], start[..., 3:6] - 0.3)
        torch.testing.assert_close(end[..., 6], 2.25 * start[..., 6])

    def test_only_the_target_is_offset_and_patches_are_apart(self, data_folder: Path):
        cells = ("s1_a0.6_b0", "s1_a0.6_b0.2", "s2_a0.6_b0")
        cases = {c.name: c for c in make_cases(data_folder, cells, size=SIZE) if "Wood" in c.key}
        plain, rough, other = (cases[name] for name in cells)
        assert plain.source_key == rough.source_key != other.source_key
        torch.testing.assert_close(texels_of(plain.source), texels_of(rough.source))
        gained = texels_of(rough.target)[0] - texels_of(plain.target)[0]
        torch.testing.assert_close(gained[..., 6], torch.full((SIZE, SIZE), 0.2))
        assert bool((gained[..., :6] == 0).all())
        shifted = texels_of(plain.target)[0, ..., 0] - texels_of(other.target)[0, ..., 0]
        torch.testing.assert_close(shifted, torch.full((SIZE, SIZE), 0.1))
        assert not torch.equal(texels_of(plain.source)[0], texels_of(other.target)[0])

    def test_the_first_frame_of_a_mixture_tells_its_phase(self):
        weights = mixed_weights(16, 1).astype(np.float64)
        start = np.log(1 / weights[0] - 1) / 6
        assert start.min() == pytest.approx(-0.2, abs=1e-3)
        assert start.max() == pytest.approx(0.6, abs=1e-3)
        np.testing.assert_allclose(weights[-1], 1 / (1 + np.exp(-6 * (1 - start))), atol=1e-5)

    def test_spots_start_where_the_first_frame_does_not_say(self, data_folder: Path):
        (case,) = make_cases(data_folder, ("s4",), size=32)
        assert isinstance(case.target, Sequence) and case.target.onset is not None
        states, onset = texels_of(case.target), torch.from_numpy(case.target.onset)
        turned = (states[18] - states[0]).abs().amax(-1) > 0
        assert bool((turned == (onset < float(case.target.times[18]))).all())
        assert 0.1 < turned.float().mean() < 0.9
        tone = states[0, ..., :3].mean(-1)
        alike = torch.corrcoef(torch.stack((tone.flatten(), onset.flatten())))[0, 1]
        assert abs(float(alike)) < 0.4

    def test_the_halves_of_real_materials_never_mix(self, data_folder: Path):
        for name in ("real_tvbtf45", "real_steelrusting"):
            (case,) = make_cases(data_folder, (name,), size=SIZE)
            assert isinstance(case.source, Sequence) and isinstance(case.target, Sequence)
            both = np.concatenate((case.source.kd, case.target.kd), 2)
            again = next(iter(make_cases(data_folder, (name,), size=SIZE)))
            assert not np.shares_memory(case.source.kd, again.target.kd)
            height, width = both.shape[1:3]
            assert height == width
            case.source.kd[:] = 7
            assert case.target.kd.max() < 7


class TestSphere:
    def test_the_table_shows_what_the_sphere_shows(self, sphere: TexturedSphere):
        g = torch.Generator().manual_seed(1)
        count = len(sphere.diffuse)
        states = torch.rand(1, count, 7, generator=g)
        states[..., 6] = 10 ** (-4 * torch.rand(1, count, generator=g))

        def look(rows, angles):
            kd, ks, alpha = states[0, rows].split((3, 3, 1), 1)
            return torrance_sparrow.evaluate(kd, ks, alpha[:, 0], angles)

        direct = sphere.sphere.render_textured(look, torch.arange(count))
        assert float(psnr(direct, sphere.render(states)).min()) > 75
        few = sphere.render_decoded(lambda i, a: look(sphere.few[i : i + 1], a), sphere.few)
        torch.testing.assert_close(few, direct[:, :, sphere.few], rtol=1e-4, atol=1e-5)

    def test_a_texel_is_a_pixel(self, sphere: TexturedSphere):
        inside = sphere.sphere.inside.flatten().nonzero()[:, 0]
        assert torch.equal(sphere.texels(SIZE, SIZE), inside)
        wide = sphere.texels(2 * SIZE, 4 * SIZE)
        assert torch.equal(wide // (4 * SIZE), 2 * (inside // SIZE) + 1)
        assert torch.equal(wide % (4 * SIZE), 4 * (inside % SIZE) + 2)


class TestMethods:
    def models(self, weights: Path, kept: Path, *names: str):
        sources = SourceModels(kept, TINY)
        return load_models(names, sources, encoder=weights / "lobes.safetensors", weights=weights)

    def test_stt_gives_the_source_back(self, data_folder, sphere, weights, tmp_path):
        (case,) = list(make_cases(data_folder, ("s2_a0.6_b0",), size=16))[:1]
        case = replace(case, target=case.source)
        stage = Stage.of(case, sphere)
        method = method_for("stt", case, self.models(weights, tmp_path, "stt"))
        frames, pixels = [0, 20, 35], torch.arange(len(stage.texels))
        scores = stage.score(method.estimate(stage, frames, pixels), frames, pixels)
        assert min(scores) > 60

    def test_constant_scores_what_a_still_image_scores(
        self, data_folder, sphere, weights, tmp_path
    ):
        (case,) = list(make_cases(data_folder, ("s1_a0.8_b0.1",), size=SIZE))[:1]
        stage = Stage.of(case, sphere)
        method = method_for("constant", case, self.models(weights, tmp_path, "constant"))
        frames, pixels = [0, 17, 35], torch.arange(len(stage.texels))
        scores = stage.score(method.estimate(stage, frames, pixels), frames, pixels)
        still = psnr(stage.truth[frames], stage.truth[:1]).mean(1)
        assert scores == pytest.approx(still.tolist(), abs=0.01)
        assert scores[0] == 100

    def test_a_source_is_learned_once_for_each_effort(self, data_folder, weights, tmp_path):
        (case,) = list(make_cases(data_folder, ("s1_a0.6_b0",), size=SIZE))[:1]
        models = self.models(weights, tmp_path, "affine")
        representation, encoder = models.encoders["ours"]
        written = []
        for effort in (TINY, TINY, replace(TINY, texels=20)):
            SourceModels(tmp_path, effort).ladder("wood", case.source, representation, encoder)
            written.append((tmp_path / "ntm_wood.safetensors").stat().st_mtime_ns)
        assert written[0] == written[1] < written[2]
        assert [path.name for path in tmp_path.iterdir()] == ["ntm_wood.safetensors"]

    def test_a_mixture_is_rendered_as_the_mixed_spheres(self, data_folder, sphere):
        case = next(iter(make_cases(data_folder, ("s3",), size=SIZE)))
        stage = Stage.of(case, sphere)
        direct = sphere.render_decoded(
            lambda place, angles: stage.values(9, torch.tensor([place]), angles),
            torch.arange(len(stage.texels)),
        )
        torch.testing.assert_close(direct[0], stage.truth[9], rtol=1e-3, atol=1e-4)

    @pytest.mark.usefixtures("data_folder")
    def test_a_fitted_mixture_starts_and_ends_as_its_materials(self):
        weights = np.linspace(0, 1, 3, dtype=np.float32)[:, None, None]
        mixture = MixtureSequence(
            ("pink-felt", "blue-acrylic"), weights, np.linspace(0, 1, 3, dtype=np.float32), "x"
        )
        kd = as_parameters(mixture).kd[:, 0, 0]
        assert kd[0, 0] > kd[0, 2]
        assert kd[2, 2] > kd[2, 0]


class TestNumbers:
    def test_the_given_frame_is_in_no_number(self):
        numbers = Curve((0, 1, 2), (100.0, 40.0, 30.0), 3).json()
        assert numbers == {"mean": 35.0, "final": 30.0, "min": 30.0}

    def test_between_scored_frames_a_curve_is_a_line(self):
        curve = Curve((0, 1, 5), (100.0, 40.0, 32.0), 6)
        np.testing.assert_allclose(curve.every, (40, 38, 36, 34, 32))

    def test_means_are_over_the_frames_that_all_have(self):
        mean = averaged([Curve((0, 1, 2, 3), (9, 8, 7, 6), 4), Curve((0, 1, 3), (7, 6, 2), 4)])
        assert mean == Curve((0, 1, 3), (8.0, 7.0, 4.0), 4)

    def test_the_strip_s_frames_are_the_paper_s(self):
        assert [frame + 1 for frame in synthesis_scoring.strip_frames(36)] == [1, 9, 18, 27, 36]
        assert [frame + 1 for frame in synthesis_scoring.strip_frames(21)] == [1, 5, 10, 15, 21]
