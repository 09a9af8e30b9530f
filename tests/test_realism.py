"""`evaluate realism`: its distance, its profiles and spots, its figures, and that it resumes."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model_runtime.errors import InputError, UsageError
from training.evaluation.realism.evaluate import evaluate_realism
from training.evaluation.realism.figures import HALF_WAY, figures_of
from training.evaluation.realism.relief import BINS, compare_profiles, profile, weathered
from training.evaluation.realism.report import tables
from training.evaluation.realism.results import Compared, Target
from training.evaluation.realism.spots import LAPSES, apart, halves_of, spot_curves, spread
from training.evaluation.synthesis.sources import Effort
from training.metric.texture import LAYERS, TextureMetric, Textures
from training.ntm import NTMConfig

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = Effort(NTMConfig(iterations=2, batch=8), 24, NTMConfig(iterations=2, batch=8), 2)


def picture(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGB"), np.float32) / 255


@pytest.fixture(scope="module")
def metric(data_folder: Path) -> TextureMetric:
    return TextureMetric.load(data_folder / "perceptual")


@pytest.fixture(scope="module")
def rusting(data_folder: Path) -> np.ndarray:
    return picture(data_folder / "scans/Metal022/Metal022_1K-JPG_Color.jpg")


class TestDistance:
    def test_quarters_of_a_scan_are_as_far_apart_as_they_were_found_to_be(
        self, metric: TextureMetric, rusting: np.ndarray
    ):
        """0.04 in AGEING.md, for Metal022."""
        first, second = (
            metric.seen(rusting[part, part]) for part in (slice(512), slice(512, None))
        )
        assert metric.distance(first, second).distance == pytest.approx(0.04, abs=0.01)

    def test_nothing_is_as_near_as_itself_and_its_mean_color_is_far(
        self, metric: TextureMetric, rusting: np.ndarray
    ):
        whole = rusting[:160, :160]
        flat = np.broadcast_to(whole.mean((0, 1)), whole.shape)
        seen, mean = metric.seen(whole), metric.seen(flat)
        assert metric.distance(seen, seen).distance == 0
        assert metric.distance(seen, mean).distance == metric.distance(mean, seen).distance > 0.5

    def test_without_the_network_it_says_so(self, tmp_path: Path):
        with pytest.raises(InputError, match="VGG16"):
            TextureMetric.load(tmp_path)


class TestRelief:
    def chips(self, lip: float) -> tuple[np.ndarray, np.ndarray]:
        """Round chips 0.3 deep, and heights whose rims stick out by `lip` within 4 texels."""
        y, x = np.mgrid[:256, :256]
        centers = ((64, 64), (64, 190), (180, 120))
        inside = np.max([24 - np.hypot(y - a, x - b) for a, b in centers], 0)
        rim = lip * ((inside < 0) & (inside > -4))
        return inside > 0, (0.5 - 0.3 * (inside > 0) + rim).astype(np.float32)

    def test_a_lip_before_the_drop_is_seen(self):
        mask, height = self.chips(0.1)
        found = profile(height, mask, wraps=False)
        assert 0.2 < found.lip < 0.4
        middle = (BINS[1:] + BINS[:-1]) / 2
        inside = np.array(found.height)[(middle > 3) & (middle < 12)]
        np.testing.assert_allclose(inside, -1, atol=0.15)

    def test_without_one_there_is_none_and_units_do_not_matter(self):
        (mask, with_lip), (_, without) = self.chips(0.1), self.chips(0.0)
        truth = profile(with_lip, mask, wraps=False)
        alike, lip = compare_profiles(truth, profile(1e-3 * with_lip, mask, wraps=False))
        assert (round(alike, 3), lip) == (1, True)
        alike, lip = compare_profiles(truth, profile(without, mask, wraps=False))
        assert alike > 0.8
        assert not lip

    def test_what_is_weathered_is_told_by_color(self):
        clean, gone = np.array((0.1, 0.2, 0.8)), np.array((0.6, 0.3, 0.1))
        image = np.where(np.arange(64)[:, None, None] < 32, clean, gone) + np.zeros((64, 64, 3))
        mask = weathered(image.astype(np.float32), clean, gone)
        assert not mask[4:28].any()
        assert mask[36:60].all()


class TestSpots:
    FIRST, LAST = np.array((0.5, 0.5, 0.5)), np.array((0.3, 0.1, 0.05))

    def frames(self, count: int, radius: float) -> np.ndarray:
        """Two frames: nothing, then `count` discs in a row."""
        y, x = np.mgrid[:100, :100]
        spots = np.zeros((100, 100), bool)
        for k in range(count):
            spots |= np.hypot(y - 50, x - 12 - 25 * k) < radius
        last = np.where(spots[..., None], self.LAST, self.FIRST)
        return np.stack((np.broadcast_to(self.FIRST, last.shape), last)).astype(np.float32)

    def test_discs_are_counted_and_measured(self):
        number, area, perimeter = spot_curves(self.frames(3, 8), self.FIRST, self.LAST)
        assert (number[0], area[0], perimeter[0]) == (0, 0, 0)
        assert number[1] == 3 * 1e6 / 100**2
        assert area[1] == pytest.approx(3 * np.pi * 8**2 / 100**2, rel=0.05)
        assert perimeter[1] == pytest.approx(3 * 8 * 8 / 100**2, rel=0.1)  # of a disc on a grid

    def test_the_same_are_not_apart_and_a_sequence_has_a_spread(self):
        frames = self.frames(3, 8)
        curves = {k: spot_curves(v, self.FIRST, self.LAST) for k, v in halves_of(frames).items()}
        assert set(apart(curves["left"], curves["left"]).values()) == {0}
        down, across = ("left", "right"), ("upper", "lower")
        assert spread(curves, [down])["number"] > spread(curves, [across])["number"] == 0
        assert spread(curves, [across, down]) == spread(curves, [down])

    def test_on_a_film_light_is_no_spot(self):
        film, first = LAPSES["copper_patinating"], self.frames(3, 8)
        light = np.linspace(0.4, 1.6, 100)[:, None]
        start, end = film.seen(self.FIRST), film.seen(self.LAST)
        even, lit = (spot_curves(film.seen(each), start, end) for each in (first, first * light))
        np.testing.assert_allclose(lit, even)
        assert even[0, 1] == 3 * 1e6 / 100**2


class TestFigures:
    def target(self, **distances: float) -> Target:
        compared = {
            name: Compared(Textures((each,) * len(LAYERS)), 1.0, 2.0)
            for name, each in distances.items()
        }
        return Target(compared, 30.0)

    def test_ours_has_to_be_near_and_nearer_than_all_others(self):
        near = self.target(ours=0.08, stt=0.3, same_scan=0.03, other_scan=0.2)
        beaten = self.target(ours=0.19, stt=0.1, same_scan=0.03)
        first, second, learning = figures_of(
            {"Metal022": near, "Metal022" + HALF_WAY: beaten}, {}, {}
        )
        assert first.met
        assert first.measured == "0.080; nearest rival other_scan 0.200"
        assert not second.met
        assert learning.met

    def test_relief_needs_its_lip(self):
        own = {"correlation": 0.99}
        found = {"correlation": 0.95, "lip": False, "own_half": own}
        assert not figures_of({}, found, {})[0].met
        assert figures_of({}, {**found, "lip": True}, {})[0].met
        assert not figures_of({}, {**found, "correlation": None}, {})[0].met


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("realism ü")


def evaluate(data: Path, output: Path):
    names = ("ours", "ours_v1", "crossfade", "stt", "paper", "same_scan", "other_scan")
    return evaluate_realism(
        data, output, methods=names, targets=("Metal022", "rusts"), size=256, times=3, effort=TINY,
        minutes=0.002,
    )  # fmt: skip


@pytest.fixture(scope="module")
def report(data_folder: Path, output: Path):
    return evaluate(data_folder, output)


@pytest.mark.slow
class TestReport:
    def test_all_methods_are_held_against_both_states(self, report, output: Path):
        stored = json.loads((output / "realism.json").read_text(encoding="utf-8"))
        assert set(stored["targets"]) == {"Metal022", "Metal022_half"}
        for target in stored["targets"].values():
            assert set(target["methods"]) == set(report.settings["methods"])
            for found in target["methods"].values():
                assert set(found["layers"]) == set(LAYERS)
                assert 0 < found["distance"] < 3
        assert all(figure["asked"] for figure in stored["figures"])
        assert "nearest rival" in tables(report)

    def test_scans_of_rust_are_held_against_each_other(self, report):
        assert "| rust of | Rust004 |" in tables(report)
        assert all(list(others) == list(report.rusts) for others in report.rusts.values())
        others = report.rusts["Rust004"]
        assert others["Rust004"] == min(others.values())

    def test_its_pictures_are_there(self, report, output: Path):
        page = (output / "realism.md").read_text(encoding="utf-8")
        for name in ("realism.png", "sheet_Metal022.png"):
            assert name in page
            assert Image.open(output / name).size[0] > 200

    def test_the_next_call_finds_all_of_it(self, report, data_folder: Path, output: Path):
        start = time.perf_counter()
        again = evaluate(data_folder, output)
        assert time.perf_counter() - start < report.seconds / 2
        assert again.json()["targets"] == report.json()["targets"]

    def test_targets_that_do_not_exist_are_refused(self, data_folder: Path, tmp_path: Path):
        with pytest.raises(UsageError, match="target 'Gold'"):
            evaluate_realism(data_folder, tmp_path, targets=("Gold",))


@pytest.mark.slow
def test_relief_and_spots_are_told_beside_what_is_real(data_folder: Path, tmp_path: Path):
    report = evaluate_realism(
        data_folder, tmp_path, methods=("ours", "ode", "same_scan"), size=512, times=5,
        targets=("relief", "copper", "spots"), minutes=0.002,
    )  # fmt: skip
    stored = json.loads((tmp_path / "realism.json").read_text(encoding="utf-8"))
    assert stored["relief"]["own_half"]["correlation"] > 0.9
    assert stored["relief"]["truth"]["lip"] > 0.03  # its paint lifts before it goes
    profile = stored["relief"]["ours"]["height"]
    assert len(profile) == len(stored["relief"]["distance"])
    for found in stored["spots"].values():
        assert (
            set(found["apart"]["ours"]) == set(found["spread"]) == {"number", "area", "perimeter"}
        )
        assert len(found["curves"]["ours"]) == 3
    for age in ("0.05", "0.25", "0.5", "0.75", "1"):
        far = stored["targets"][f"copper_{age}"]["methods"]
        assert 0 < far["same_scan"]["distance"] < far["ode"]["distance"] < 2
    assert set(stored["spots"]["copper_patinating"]["apart"]) == {"ours", "ode"}
    assert stored["costs"]["ours"]["learn"] < stored["costs"]["ode"]["learn"]
    assert "a picture of 128" in tables(report)
    assert len(report.figures) == 5
    for name in ("relief.png", "spots.png", "rival.jpg"):
        assert (tmp_path / name).exists()
