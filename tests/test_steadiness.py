"""What training sees of a source that cannot be trusted, and that `age` repeats it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import MODELS, load_model, save_model
from tests.aging import run
from training.data.kinetics import PROCESSES
from training.data.sequences import MixtureSequence, Sequence, uniform_times
from training.data.weathering import generate
from training.source.steadiness import (
    evened_out,
    flicker,
    frames_that_stand_out,
    steadied,
    widest_gap,
)


@pytest.fixture(scope="module")
def rusting() -> Sequence:
    return generate("rust", size=32)


def lit(sequence: Sequence, light: np.ndarray) -> Sequence:
    """Every frame's Kd and Ks times its `light` [T]."""
    light = light.astype(np.float32)[:, None, None, None]
    return replace(sequence, kd=sequence.kd * light, ks=sequence.ks * light)


def only(sequence: Sequence, frames) -> Sequence:
    parts = {name: getattr(sequence, name)[frames] for name in ("kd", "ks", "alpha", "times")}
    return replace(sequence, **parts)


class TestSteadiness:
    @pytest.mark.parametrize("process", PROCESSES)
    def test_our_own_processes_are_steady(self, process: str):
        sequence = generate(process, size=24)
        found = steadied(sequence)
        assert isinstance(found, Sequence) and found.warnings == ()
        np.testing.assert_array_equal(found.kd, sequence.kd)
        assert flicker(sequence) < 0.01

    @pytest.mark.parametrize("frame", [17, 34])
    @pytest.mark.parametrize("factor", [0.0, 2.0, 100.0])
    def test_a_frame_that_stands_out_is_left_out_and_named(self, rusting, frame, factor):
        light = np.ones(36)
        light[frame] = factor
        found = steadied(lit(rusting, light))
        assert isinstance(found, Sequence)
        kept = np.delete(np.arange(36), frame)
        np.testing.assert_array_equal(found.kd, rusting.kd[kept])
        np.testing.assert_array_equal(found.times, rusting.times[kept])
        assert f"Frame {frame + 1} stood out" in found.warnings[0]

    def test_a_short_sequence_has_outliers_too(self, rusting):
        short = only(rusting, [0, 7, 14, 21, 28, 35])
        assert frames_that_stand_out(lit(short, np.array([1, 1, 1, 5, 1, 1]))) == [3]

    @pytest.mark.parametrize("strength", [0.03, 0.1, 0.2])
    def test_flicker_is_as_strong_as_the_light_is_unsteady(self, rusting, strength):
        noise = np.random.default_rng(0).standard_normal(36)
        found = flicker(lit(replace(rusting, onset=None), 1 + strength * noise))
        assert found == pytest.approx(strength, rel=0.5)

    def test_flicker_is_said_and_no_frame_taken_for_an_outlier(self, rusting):
        noise = np.random.default_rng(1).choice((-1, 1), 36)
        found = steadied(lit(rusting, 1 + 0.15 * noise))
        assert isinstance(found, Sequence)
        assert len(found.times) > 32
        assert any("flickered" in warning for warning in found.warnings)

    @pytest.mark.parametrize("process", ["rust", "fading"])
    def test_light_that_is_evened_out_is_nearer_to_steady(self, process: str):
        sequence = replace(generate(process, size=32), onset=None)
        light = 1 + 0.1 * np.random.default_rng(2).standard_normal(36)

        def error(found: Sequence) -> float:
            return float(np.abs(np.log((found.kd + 1e-9) / (sequence.kd + 1e-9))).mean())

        unsteady = lit(sequence, light)
        assert error(evened_out(unsteady)) < 0.6 * error(unsteady)

    def test_few_frames_and_gaps_are_said(self, rusting):
        for frames in ([0, 35], [0, 17, 35]):
            found = steadied(only(rusting, frames))
            assert [f"only {len(frames)} frames" in text for text in found.warnings] == [True]
        found = steadied(only(rusting, [*range(10), *range(25, 36)]))
        assert any("no frames for 46%" in text for text in found.warnings), found.warnings
        assert widest_gap(uniform_times(5)) == pytest.approx(0.25)

    def test_mixtures_are_taken_as_they_are(self):
        weights = np.zeros((2, 1, 1), np.float32)
        mixture = MixtureSequence(("a", "b"), weights, uniform_times(2), "m")
        assert steadied(mixture) is mixture


class TestDoubts:
    def changed(self, path: Path, warnings: object) -> Path:
        tensors, card = load_model(MODELS / "rust.safetensors", "ntm")
        save_model(path, tensors, {**card.details, "warnings": warnings}, kind="ntm")
        return path

    def test_age_repeats_what_training_doubted(self, steel, tmp_path):
        ntm = self.changed(tmp_path / "doubtful.safetensors", ["There was a gap."])
        report = run(steel, tmp_path / "aged", ntm=str(ntm), frames=2, size=8)
        assert any(text.endswith("There was a gap.") for text in report["warnings"])

    @pytest.mark.parametrize("warnings", ["a text", [1], {"a": "b"}])
    def test_a_card_with_anything_else_is_refused(self, steel, tmp_path, warnings):
        ntm = self.changed(tmp_path / "odd.safetensors", warnings)
        with pytest.raises(ModelFileError):
            run(steel, tmp_path / "aged", ntm=str(ntm), frames=2, size=8)
