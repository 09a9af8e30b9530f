"""How aging models: whatever the threads, the palette, the rung and the onset."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from model_runtime.backend import NAME, torch
from model_runtime.contract import LADDER, NUMPY
from model_runtime.errors import InputError
from model_runtime.images import read_image, write_exr
from model_runtime.model_files.weights import ModelCard, save_model
from model_runtime.output import stored
from model_runtime.representation import load_representation
from model_runtime.temporal.domain import Domain
from model_runtime.temporal.models import Affine, LatentLSTM, ParameterLSTM
from model_runtime.temporal.ntm import NeuralTemporalModel
from model_runtime.temporal.pace import Timing
from tests.aging import (
    COLORS,
    PRINCIPLED,
    TORRANCE_SPARROW,
    Listener,
    contents,
    frames_of,
    run,
    write_painted_steel,
    write_torrance_sparrow,
)


@pytest.fixture
def floats(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., dict[str, np.ndarray]]]:
    """Runs an aging and gives what it would write, before it is rounded to half floats."""
    threads = torch.get_num_threads()

    def aged(source: Path, output: Path, **options) -> dict[str, np.ndarray]:
        written: dict[str, np.ndarray] = {}

        def keep(path: Path, pixels: np.ndarray, **options) -> None:
            written[path.name] = pixels.copy()
            write_exr(path, pixels, **options)

        monkeypatch.setattr(stored, "write_exr", keep)
        run(source, output, **options)
        return written

    yield aged
    torch.set_num_threads(threads)


@pytest.mark.skipif(NAME == NUMPY, reason="its threads are not for us to say")
@pytest.mark.parametrize("rung", ["auto", "lstm_latents"])
def test_threads_change_nothing(floats, tmp_path: Path, rung: str):
    source = write_painted_steel(tmp_path / "paint", 8)
    options = {"frames": 3, "format": "torrance-sparrow", "temporal_model": rung}
    torch.set_num_threads(1)
    one = floats(source, tmp_path / "one", **options)
    torch.set_num_threads(2)
    two = floats(source, tmp_path / "two", **options)
    assert one.keys() == two.keys()
    assert torch.get_num_threads() == 2  # the caller's setting is left as it was
    for name, pixels in one.items():
        np.testing.assert_allclose(two[name], pixels, rtol=1e-5, atol=1e-7, err_msg=name)


def displayed(maps: dict[str, np.ndarray]) -> np.ndarray:
    """(1 - exp(-2 pi f))^(1/2.8) of Torrance-Sparrow maps, mirror-like pairs of directions at
    several half vectors, in float64 by docs/design.md's formula.
    """
    kd, ks, alpha = (maps[name].astype(float) for name in TORRANCE_SPARROW)
    alpha = np.clip(alpha, 1e-4, 1)[..., None]
    shown = []
    for theta_h in (0.0, 0.05, 0.2, 0.5):  # light and eye at this angle from the normal
        cos2, tan2 = math.cos(theta_h) ** 2, math.tan(theta_h) ** 2
        d = alpha**2 / (math.pi * cos2**2 * (alpha**2 + tan2) ** 2)
        g1 = 2 / (1 + np.sqrt(1 + alpha**2 * tan2))
        f = kd / math.pi + ks * d * g1**2 / (4 * cos2)
        shown.append((1 - np.exp(-2 * math.pi * f)) ** (1 / 2.8))
    return np.stack(shown)


def psnr(truth: np.ndarray, estimate: np.ndarray) -> float:
    error = float(((truth - estimate) ** 2).mean())
    return 100.0 if error < 1e-10 else -10 * math.log10(error)


@pytest.mark.parametrize(
    ("rung", "size"), [("affine", 16), ("lstm_parameters", 16), ("lstm_latents", 12)]
)
def test_balanced_is_within_the_tolerance_of_exact(tmp_path: Path, rung: str, size: int):
    source = write_painted_steel(tmp_path / "paint", size)
    options = {"frames": 5, "temporal_model": rung, "format": "torrance-sparrow"}
    exact = run(source, tmp_path / "exact", quality="exact", **options)
    balanced = run(source, tmp_path / "balanced", tolerance=45.0, **options)
    assert exact["palette"] == size * size
    assert balanced["palette"] < exact["palette"]
    for k in range(5):
        both = [
            displayed({name: frames_of(tmp_path / q, name, 5)[k] for name in TORRANCE_SPARROW})
            for q in ("exact", "balanced")
        ]
        assert psnr(*both) >= 44.5, f"frame {k + 1}"


def test_a_tolerance_that_is_missed_is_said(tmp_path: Path):
    """4,096 texels of noise are more than any palette holds; 99 dB is more than it can reach."""
    source = write_torrance_sparrow(tmp_path / "noise", size=64)
    rng = np.random.default_rng(0)
    write_exr(source / "kd.exr", rng.random((64, 64, 3), np.float32))
    listener = Listener()
    options = {
        "tolerance": 99.0,
        "frames": 2,
        "onset": "none",
        "temporal_model": "lstm_parameters",
    }
    aged = run(source, tmp_path / "aged", listener, **options)
    (said,) = aged["warnings"]
    assert "99 dB" in said
    assert "exact" in said
    assert listener.warnings == [said]
    assert run(source, tmp_path / "exact", quality="exact", **options)["warnings"] == []


def test_rust_spreads_over_uniform_steel(steel: Path, tmp_path: Path):
    """Between frames 9 and 27 of 36 at least a fifth of the texels are as they were, at least a
    fifth have turned, and the border moves.

    As they were: not one step of an 8-bit display away. Turned: at least half of the way from
    steel to rust, which is what the earliest texels are at the end; square roots, as seen.
    """
    run(steel, tmp_path / "out", size=192)  # a smaller one has a texel too many or too few
    stacks = [frames_of(tmp_path / "out", name, 36) for name in TORRANCE_SPARROW]
    seen = np.sqrt(np.concatenate((*stacks[:2], stacks[2][..., None]), -1).astype(float))
    change = seen - seen[0]
    amount = np.abs(change).max(-1)
    first = amount[4] >= np.quantile(amount[4], 0.95)
    whole = np.median(change[-1][first], 0)
    progress = change @ whole / (whole @ whole)
    turned, same = progress > 0.5, amount < 1 / 255
    for k in range(8, 27):  # frames 9 to 27
        assert same[k].mean() >= 0.2, f"frame {k + 1}"
        assert turned[k].mean() >= 0.2, f"frame {k + 1}"
    for k in range(8, 26, 3):
        assert (turned[k + 3] & ~turned[k]).mean() > 0.005  # it gains ground
        assert (turned[k] & ~turned[k + 3]).mean() < 0.01  # and loses none


def plain_ntm(folder: Path, timing: Timing) -> Path:
    """An NTM of 9 ages by which Kd grows evenly by 0.5, whatever it was."""
    affine = Affine(torch.ones(9, 7), torch.zeros(9, 7))
    affine.offset[:, :3] = torch.linspace(0, 0.5, 9)[:, None]
    path = folder / "plain.safetensors"
    card = {
        "name": "plain",
        "title": "Plain",
        "frames": 9,
        "representation": load_representation()[1],
        "temporal_model": "affine",
        "timing": timing.json(),
    }
    parts = (
        ParameterLSTM(),
        LatentLSTM(12, 8),
        Domain(torch.full((1, 7), 0.5), torch.full((1,), 2.0)),
    )
    ntm = NeuralTemporalModel(ModelCard(path, "ntm", 1, "plain", "Plain"), affine, *parts)
    save_model(path, ntm.tensors(), card, kind="ntm")
    return path


class TestOnset:
    def test_uniform_without_onset_is_one_texel(self, steel: Path, tmp_path: Path):
        report = run(steel, tmp_path / "out", frames=4, onset="none")
        assert (report["size"], report["palette"]) == ([1, 1], 1)
        assert frames_of(tmp_path / "out", "kd", 4).shape == (4, 1, 1, 3)

    def test_uniform_with_onset_is_a_texture(self, steel: Path, tmp_path: Path):
        report = run(steel, tmp_path / "out", frames=3, size=48)
        assert (report["size"], report["palette"]) == ([48, 48], 1)
        kd = frames_of(tmp_path / "out", "kd", 3)
        assert kd[0].std() < 1e-6
        assert kd[1].std() > 0.01

    def test_textures_without_onset_change_all_at_once(self, paint: Path, tmp_path: Path):
        run(paint, tmp_path / "out", frames=4, size=16, onset="none")
        base = frames_of(tmp_path / "out", "base_color", 4)
        assert (np.abs(base[1] - base[0]).max(-1) > 0).mean() > 0.99

    @pytest.mark.parametrize("uniform", [False, True], ids=["texture", "uniform"])
    def test_an_image_says_when(self, paint: Path, steel: Path, tmp_path: Path, uniform: bool):
        """Left starts at 0, the middle at 1/2, the right never."""
        onset = np.repeat([[0.0, 0.5, 1.0]], 32, 0).repeat((16, 8, 8), 1).astype(np.float32)
        write_exr(tmp_path / "onset.exr", onset)
        source, name = (steel, "kd") if uniform else (paint, "base_color")
        options = {"grain": 0.0} if uniform else {"size": 32}
        run(source, tmp_path / "out", frames=5, onset=str(tmp_path / "onset.exr"), **options)
        values = frames_of(tmp_path / "out", name, 5)
        assert values.shape == (5, 32, 32, 3)
        changed = (values != values[:1]).any(-1).mean(1)  # [T, columns]
        for k in range(5):
            assert (changed[k, :16] > 0.95).all() == (k > 0)
            assert (changed[k, 16:24] > 0.95).all() == (k > 2)
            assert (changed[k, 24:] == 0).all()
        if uniform:  # a texel's age alone counts: half a unit later, the same
            np.testing.assert_allclose(values[4, 0, 20], values[2, 0, 0], rtol=1e-3)

    def test_without_onset_a_material_changes_as_the_source_did_on_average(
        self, steel: Path, tmp_path: Path
    ):
        """Kd grows with age by 0.5; half of the source starts at 0, half never."""
        half = Timing.of(np.array((0.0, 1.0)).repeat(50))
        options = {"ntm": str(plain_ntm(tmp_path, half)), "frames": 5, "onset": "none"}
        run(steel, tmp_path / "out", **options)
        kd = frames_of(tmp_path / "out", "kd", 5)[:, 0, 0, 0]
        np.testing.assert_allclose(kd - kd[0], np.linspace(0, 0.25, 5), atol=4e-3)

    def test_what_changed_everywhere_at_once_gets_no_pattern(self, steel: Path, tmp_path: Path):
        ntm = str(plain_ntm(tmp_path, Timing.of(0.0)))
        for onset in ("auto", "none"):
            report = run(steel, tmp_path / onset, ntm=ntm, frames=5, onset=onset)
            assert report["size"] == [1, 1]
            kd = frames_of(tmp_path / onset, "kd", 5)[:, 0, 0, 0]
            np.testing.assert_allclose(kd - kd[0], np.linspace(0, 0.5, 5), atol=1e-3)

    def test_a_pattern_keeps_the_pace_of_the_source(self, steel: Path, tmp_path: Path):
        """A quarter starts at 0, a quarter at mid-time, half never."""
        ntm = plain_ntm(tmp_path, Timing.of(np.array((0.0, 0.5, 1.0, 1.0)).repeat(50), scale=0.1))
        run(steel, tmp_path / "out", ntm=str(ntm), frames=5, size=64)
        kd = frames_of(tmp_path / "out", "kd", 5)[..., 0]
        changed = (kd > kd[0] + 1e-3).mean((1, 2))
        np.testing.assert_allclose(changed, (0, 0.25, 0.25, 0.5, 0.5), atol=0.04)

    def test_another_seed_is_another_pattern(self, steel: Path, tmp_path: Path):
        ends = []
        for seed in (1, 1, 2):
            run(steel, tmp_path / "out", frames=3, size=32, seed=seed)
            ends.append(frames_of(tmp_path / "out", "kd", 3)[1])
        np.testing.assert_array_equal(ends[0], ends[1])
        assert (ends[0] != ends[2]).any()

    @pytest.mark.parametrize("value", [-0.1, 1.5, math.nan])
    def test_an_image_out_of_range_is_refused(self, steel: Path, tmp_path: Path, value: float):
        channels = {"Y": np.full((4, 4), value, np.float32)}
        OpenEXR.File({"type": OpenEXR.scanlineimage}, channels).write(str(tmp_path / "onset.exr"))
        with pytest.raises(InputError, match="outside 0 to 1"):
            run(steel, tmp_path / "out", frames=2, onset=str(tmp_path / "onset.exr"))
        assert not (tmp_path / "out").exists()

    def test_a_missing_image_is_refused(self, steel: Path, tmp_path: Path):
        with pytest.raises(InputError, match=r"none\.exr"):
            run(steel, tmp_path / "out", frames=2, onset=str(tmp_path / "none.exr"))


class TestSparse:
    @pytest.mark.parametrize("onset", ["auto", "none"])
    @pytest.mark.parametrize("tolerance", [35.0, 50.0])
    def test_the_mixes_rebuild_every_frame(
        self, paint: Path, tmp_path: Path, tolerance: float, onset: str
    ):
        options = {"frames": 12, "tolerance": tolerance, "onset": onset}
        report = run(paint, tmp_path / "sparse", sparse=True, **options)
        whole = run(paint, tmp_path / "whole", **options)
        assert report["files"].keys() == whole["files"].keys()
        used = set()
        for name, mixes in report["files"].items():
            assert len(mixes) == 12
            truth = frames_of(tmp_path / "whole", name, 12)
            for k, mix in enumerate(mixes):
                used |= {file for file, _ in mix}
                assert sum(weight for _, weight in mix) == pytest.approx(1)
                rebuilt = sum(
                    weight * read_image(tmp_path / "sparse" / file, color=name in COLORS)
                    for file, weight in mix
                )
                seen = abs if name == "height" else np.sqrt  # which has a sign
                assert psnr(seen(truth[k]), seen(rebuilt)) >= tolerance - 0.1
            np.testing.assert_array_equal(
                read_image(tmp_path / "sparse" / f"{name}_0001.exr", color=name in COLORS),
                truth[0],
            )
        assert set(contents(tmp_path / "sparse")) == used | {"aged.json"}
        if onset == "none":  # smooth in time: few frames say it all
            assert len(used) < 12 * len(report["files"])

    def test_what_does_not_change_is_written_once(self, paint: Path, tmp_path: Path):
        report = run(
            paint, tmp_path / "out", frames=5, size=16, temporal_model="constant", sparse=True
        )
        for name in PRINCIPLED:
            assert report["files"][name] == [[[f"{name}_0001.exr", 1.0]]] * 5
        assert len(contents(tmp_path / "out")) == 5


class TestTemporalModels:
    @pytest.mark.parametrize("rung", LADDER)
    def test_each_can_be_asked_for(self, paint: Path, tmp_path: Path, rung: str):
        report = run(paint, tmp_path / "out", frames=3, size=8, temporal_model=rung)
        assert report["temporal_model"] == rung
        base = frames_of(tmp_path / "out", "base_color", 3)
        source = run(paint, tmp_path / "one", frames=1, size=8, temporal_model="constant")
        assert source["frames"] == 1
        np.testing.assert_array_equal(base[0], frames_of(tmp_path / "one", "base_color", 1)[0])
        moved = float(np.abs(base[-1] - base[0]).mean())
        assert moved == pytest.approx(0, abs=1e-3) if rung == "constant" else moved > 0.02

    def test_a_foreign_material_is_noticed_and_gets_an_affine_change(self, tmp_path: Path):
        """Albedos of 3: no material at all, so far from all that any model has seen."""
        source = write_torrance_sparrow(tmp_path / "in", (3, 0, 3), (0, 3, 3), 0.9)
        listener = Listener()
        report = run(source, tmp_path / "out", listener, frames=3, onset="none")
        assert report["temporal_model"] == "affine"
        assert len(report["warnings"]) == 1
        assert "100%" in report["warnings"][0]
        assert listener.warnings == report["warnings"]
        values = frames_of(tmp_path / "out", "kd", 3)
        assert np.isfinite(values).all()
        assert values.min() >= 0

    def test_unless_a_model_was_chosen(self, tmp_path: Path):
        source = write_torrance_sparrow(tmp_path / "in", (3, 0, 3), (0, 3, 3), 0.9)
        for rung in ("lstm_parameters", "lstm_latents"):
            report = run(source, tmp_path / "out", frames=2, onset="none", temporal_model=rung)
            assert (report["temporal_model"], report["warnings"]) == (rung, [])
            assert np.isfinite(frames_of(tmp_path / "out", "kd", 2)).all()
