"""The report `evaluate stability`: its stresses, what counts as failure, and that it resumes."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import torch

from model_runtime.errors import UsageError
from model_runtime.images import write_exr
from model_runtime.model_files.weights import ENCODER
from model_runtime.representation import load_representation
from tests.aging import frames_of, run
from training.data.weathering import generate
from training.evaluation.stability.evaluate import STRESSES, evaluate_stability
from training.evaluation.stability.restart import killed_training
from training.evaluation.stability.results import MethodResult, StabilityReport
from training.evaluation.stability.runs import Outcome
from training.evaluation.stability.trials import EVERY, TrialSetup
from training.evaluation.synthesis.sources import Effort, SourceModels
from training.ntm import NTMConfig

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = Effort(NTMConfig(iterations=4, batch=8), 24, NTMConfig(iterations=2, batch=8), 2)
SIZE = 8
SOME = ("nan", "broken_texel", "palette", "rollout")


def evaluate(data: Path, output: Path, **options) -> StabilityReport:
    options = {"stresses": SOME, "methods": ("ours", "stt", "affine")} | options
    return evaluate_stability(data, output, pixels=SIZE, stride=4, effort=TINY, **options)


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("stability ü")


@pytest.fixture(scope="module")
def report(data_folder: Path, output: Path) -> StabilityReport:
    return evaluate(data_folder, output)


class TestStresses:
    def test_everything_that_was_asked_for_is_there(self):
        asked = """roughness_gap color_gap alpha_small alpha_large ks_above_1 albedo_zero
            albedo_above_1 foreign_mixed foreign_part rollout resampled samples noise bits jpeg
            precision nan infinite negative broken_texel palette iridescence source_frames
            source_gap source_flicker source_outlier restart"""
        assert set(asked.split()) == set(STRESSES)

    def test_severities_are_different_and_methods_known(self):
        for name, stress in STRESSES.items():
            assert len(set(stress.severities)) == len(stress.severities) > 2, name
            assert set(stress.methods) <= set(EVERY), name
            assert stress.methods == EVERY or stress.note, f"{name} must say what it leaves out"

    def test_the_first_severity_harms_nothing(self, data_folder):
        setup = TrialSetup(data_folder, SIZE)
        for name in ("noise", "nan", "foreign_part", "foreign_mixed", "source_flicker"):
            stress = STRESSES[name]
            trial = stress.make(setup, stress.severities[0])
            np.testing.assert_array_equal(trial.case.target.kd[0], setup.start.kd)
            np.testing.assert_array_equal(trial.case.source.kd, setup.source.kd)
            if trial.given is not None:
                np.testing.assert_array_equal(trial.given.kd, setup.start.kd)

    def test_jpeg_gets_worse(self, data_folder):
        setup = TrialSetup(data_folder, SIZE)
        jpeg = STRESSES["jpeg"]
        errors = [
            np.abs(given.kd - setup.start.kd).mean()
            for quality in jpeg.severities
            if (given := jpeg.make(setup, quality).given) is not None
        ]
        assert errors[0] < 0.02 < 5 * errors[0] < errors[-1]


@pytest.fixture(scope="module")
def measured(data_folder: Path, tmp_path_factory: pytest.TempPathFactory):
    folder, methods = tmp_path_factory.mktemp("measured"), ("ours", "paper", "lstm_latents")
    report = evaluate(data_folder, folder, stresses=("iridescence",), methods=methods)
    return report.stresses["iridescence"]


@pytest.mark.slow
class TestMeasured:
    def test_latents_hold_what_no_encoder_knows(self, measured):
        for share, ours in measured["lstm_latents"].outcomes.items():
            assert ours.psnr > max(25, measured["paper"].outcomes[share].psnr), share

    def test_what_maps_do_not_hold_is_said(self, measured):
        for outcome in measured["ours"].outcomes.values():
            assert outcome.psnr > 18
        assert measured["ours"].noticed is not False
        assert measured["ours"].outcomes[1.0].said


class TestResults:
    def result(self, *outcomes: Outcome, product: bool = True) -> MethodResult:
        return MethodResult(dict(enumerate(outcomes)), product)

    def test_a_method_fails_where_it_first_gives_nothing_useful(self):
        good, bad = Outcome(40.0), Outcome(24.9)
        assert self.result(good, good).fails_at is None
        assert self.result(good, bad, good).fails_at == 1
        assert self.result(good, Outcome(math.nan)).fails_at == 1
        assert self.result(good, Outcome(40.0, in_gamut=False)).fails_at == 1
        assert self.result(good, bad).holds_to == 0

    def test_the_product_noticed_if_it_spoke_wherever_it_fails(self):
        good, quiet, loud = Outcome(40.0), Outcome(20.0), Outcome(20.0, said=("Beware.",))
        assert self.result(good, loud, loud).noticed is True
        assert self.result(good, quiet, loud).noticed is False
        assert self.result(good, good).noticed is None
        assert self.result(good, quiet, product=False).noticed is None
        assert self.result(good, loud).noticed_from == 1

    def test_rivals_that_bear_more_are_named(self):
        good, bad = Outcome(40.0), Outcome(20.0)
        methods = {
            "ours": self.result(good, bad, bad),
            "stt": self.result(good, good, bad, product=False),
            "staf": self.result(good, bad, bad, product=False),
        }
        assert StabilityReport({"x": methods}, {}, 0.0).behind("x") == {"stt": 1}


class TestReport:
    def test_the_file_holds_what_the_contract_asks(self, report, output: Path):
        stored = json.loads((output / "stability.json").read_text())
        assert set(stored["stresses"]) == set(SOME)
        for name, found in stored["stresses"].items():
            for method, numbers in found["methods"].items():
                assert method in STRESSES[name].methods
                assert {"fails_at", "noticed", "curve"} <= set(numbers)
                assert [x for x, _ in numbers["curve"]] == list(STRESSES[name].severities)
        assert "stt" not in stored["stresses"]["palette"]["methods"]

    def test_broken_texels_are_refused_and_one_that_is_only_absurd_spreads_nowhere(self, report):
        nan = report.stresses["nan"]["ours"]
        assert nan.fails_at == 1e-4 and nan.noticed is True
        assert all("NaN" in found.said[0] for x, found in nan.outcomes.items() if x > 0)
        scores = [found.psnr for found in report.stresses["broken_texel"]["ours"].outcomes.values()]
        assert max(scores) - min(scores) < 1

    def test_nothing_can_be_asked_for_after_the_source_s_end(self, report):
        found = report.stresses["rollout"]["ours"].outcomes
        assert [bool(outcome.said) for outcome in found.values()] == [False, *[True] * 4]

    def test_what_is_kept_is_not_done_again(self, report, data_folder, output, monkeypatch):
        def never(*args):
            raise AssertionError("it ran again")

        monkeypatch.setattr("training.evaluation.stability.evaluate.Trials.run", never)
        again = evaluate(data_folder, output)
        assert again.json()["stresses"] == report.json()["stresses"]

    def test_the_chart_and_the_page_are_there(self, report, output: Path):
        assert matplotlib.image.imread(output / "stability.png").ndim == 3
        page = (output / "stability.md").read_text(encoding="utf-8")
        assert all(STRESSES[name].title in page for name in SOME)

    def test_unknown_names_are_refused(self, data_folder, tmp_path):
        for options in ({"methods": ("magic",)}, {"stresses": ("magic",)}):
            with pytest.raises(UsageError, match="magic"):
                evaluate(data_folder, tmp_path, **options)


class TestProduct:
    def test_one_absurd_texel_leaves_all_others_as_they_were(self, tmp_path):
        """Its neighbors in the map and those who share its entry alike."""
        rng = np.random.default_rng(0)
        maps = {
            "kd": rng.uniform(0.02, 0.06, (16, 16, 3)),
            "ks": rng.uniform(0.4, 0.6, (16, 16, 3)),
            "alpha": rng.uniform(0.05, 0.3, (16, 16)),
        }
        aged = []
        for name, value in (("good", None), ("broken", 65504.0)):
            folder = tmp_path / name
            folder.mkdir()
            for file, pixels in maps.items():
                written = pixels.astype(np.float32)
                if value is not None:
                    written[5, 7] = value if file != "alpha" else 1
                write_exr(folder / f"{file}.exr", written)
            run(folder, tmp_path / f"{name}_aged", frames=3, onset="none")
            aged.append([frames_of(tmp_path / f"{name}_aged", file, 3) for file in maps])
        others = np.ones((16, 16), bool)
        others[5, 7] = False
        for good, broken in zip(*aged, strict=True):
            np.testing.assert_allclose(good[:, others], broken[:, others], rtol=0, atol=2e-3)


class TestRestart:
    def test_killed_and_resumed_a_ladder_ends_as_it_would_have(self, tmp_path):
        source = replace(generate("fading", size=8), onset=None)
        representation, encoder = load_representation(ENCODER)
        effort = replace(TINY, ladder=NTMConfig(iterations=30, batch=8))
        whole = SourceModels(tmp_path, effort)
        truth = whole.ladder("x", source, representation, encoder).tensors()
        killed = killed_training(whole, "x", source, 0.3)
        assert list(killed.folder.glob("*.checkpoint.safetensors")), "it had begun"
        assert not list(killed.folder.glob("ntm_x.safetensors")), "and had not ended"
        resumed = killed.ladder("x", source, representation, encoder).tensors()
        assert all(torch.equal(resumed[name], value) for name, value in truth.items())
