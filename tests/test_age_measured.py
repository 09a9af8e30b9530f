"""How aging holds measured input: as maps of one lobe or several, and live."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from model_runtime.backend import torch
from model_runtime.brdf import lobes, merl, rgl
from model_runtime.brdf.refinement import Measurements
from model_runtime.brdf.views import other_views
from model_runtime.channels import lobe_maps, turning_in
from model_runtime.live.files import read_live
from tests.aging import TORRANCE_SPARROW, frames_of, run


@pytest.fixture(scope="module")
def merl_file(place: Path) -> Path:
    """Torrance-Sparrow of Kd .2 .1 .05, Ks .3 .2 .1, alpha .3 on MERL's grid, by numpy."""
    th, td, pd = merl.grid_angles().numpy().transpose(3, 0, 1, 2)
    apart = np.sin(td) * np.cos(pd) * np.sin(th)
    cos_i, cos_o = np.cos(td) * np.cos(th) - apart, np.cos(td) * np.cos(th) + apart
    seen = (cos_i > 0) & (cos_o > 0)
    cos_i, cos_o = (np.where(seen, cos, 0.5) for cos in (cos_i, cos_o))
    a2, tan2 = 0.3**2, np.tan(th) ** 2
    lobe = a2 * (1 + tan2) ** 2 / (math.pi * (a2 + tan2) ** 2) / (4 * cos_i * cos_o)
    for cos in (cos_i, cos_o):
        lobe = lobe * 2 / (1 + np.sqrt(1 + a2 * (1 / cos**2 - 1)))
    f = np.array((0.2, 0.1, 0.05)) / math.pi + lobe[..., None] * (0.3, 0.2, 0.1)
    path = place / "made up.binary"
    merl.write(path, np.where(seen[..., None], f, -1))
    return path


class TestMeasured:
    def test_an_rgl_file(self, data_folder: Path, tmp_path: Path):
        source = data_folder / "bsdf" / "ilm_l3_37_matte_rgb.bsdf"
        report = run(source, tmp_path / "out", frames=4, onset="none")
        assert (report["format"], report["size"]) == ("torrance-sparrow", [1, 1])
        assert 0 < report["fit_error"] < 1
        assert report["measured_db"]["fit"] > 30
        assert list(report["hashes"]["input"]) == [source.name]
        kd = frames_of(tmp_path / "out", "kd", 4)[:, 0, 0]
        assert (kd > 0.001).any()
        assert np.abs(kd[-1] - kd[0]).max() > 0.01

    @pytest.mark.parametrize("rung", ["auto", "lstm_latents"])
    def test_a_merl_file_starts_as_what_was_measured(
        self, merl_file: Path, tmp_path: Path, rung: str
    ):
        report = run(merl_file, tmp_path / "out", frames=3, onset="none", temporal_model=rung)
        first = [frames_of(tmp_path / "out", name, 3)[0, 0, 0] for name in TORRANCE_SPARROW]
        np.testing.assert_allclose(first[0], (0.2, 0.1, 0.05), rtol=0.01)
        np.testing.assert_allclose(first[1], (0.3, 0.2, 0.1), rtol=0.02)
        assert first[2] == pytest.approx(0.3, rel=0.01)
        assert list(report["hashes"]["input"]) == ["made up.binary"]
        held = ["fit"] if report["temporal_model"] != "lstm_latents" else ["fit", "latents"]
        assert list(report["measured_db"]) == held
        assert min(report["measured_db"].values()) > 40

    def test_as_many_lobes_are_written_as_show_it(self, data_folder: Path, tmp_path: Path):
        """And frame 1 is as near to the measurement as is said."""
        source = data_folder / "bsdf" / "acrylic_felt_green_rgb.bsdf"
        report = run(source, tmp_path / "out", frames=3, onset="none")
        told = report["measured_db"]
        assert report["lobes"] > 1
        assert told["fit"] > told["one_lobe"] + 4
        names = (*TORRANCE_SPARROW, *lobe_maps(turning_in(report["files"], report["lobes"])))
        assert tuple(report["files"])[: len(names)] == names
        every = (*TORRANCE_SPARROW, *lobe_maps([True] * (report["lobes"] - 1)))
        files = (name if name in names else name.replace("edge", "color") for name in every)
        maps = [frames_of(tmp_path / "out", name, 3).reshape(3, -1) for name in files]
        first, _, last = torch.from_numpy(np.concatenate(maps, 1)).float()
        measured = Measurements.of(lambda angles: rgl.read(source).evaluate(angles)[None])
        shown = lobes.evaluate(first[None], other_views().angles)
        assert float(measured.psnr(shown)[0]) == pytest.approx(told["fit"], abs=0.3)
        assert bool((last != first).any())

    def test_one_lobe_is_written_where_it_suffices_or_is_asked_for(
        self, data_folder: Path, tmp_path: Path
    ):
        source = data_folder / "bsdf" / "acrylic_felt_green_rgb.bsdf"
        for options in ({"tolerance": 20.0}, {"format": "principled-exact"}):
            report = run(source, tmp_path / "out", frames=2, onset="none", **options)
            assert report["lobes"] == 1
            assert list(report["measured_db"]) == ["fit"]
            assert not [name for name in report["files"] if name.startswith("second")]

    @pytest.mark.parametrize("rung", ["affine", "lstm_latents"])
    def test_lobes_live_as_in_frames(self, data_folder: Path, tmp_path: Path, rung: str):
        source = data_folder / "bsdf" / "acrylic_felt_green_rgb.bsdf"
        for binding in ("live", "frames"):
            options = {"frames": 9, "size": 12, "grain": 0.0, "temporal_model": rung}
            report = run(source, tmp_path / binding, binding=binding, **options)
            assert (report["binding"], report["temporal_model"]) == (binding, rung)
        live = read_live(tmp_path / "live")
        for frame in (0, 4, 8):
            state = live.at(np.zeros((12, 12, 7), np.float32), frame / 8)
            shown = {"kd": state[..., :3], "ks": state[..., 3:6], "alpha": state[..., 6] ** 2}
            for name, pixels in (shown | live.further(frame / 8)).items():
                truth = frames_of(tmp_path / "frames", name, 9)[frame]
                np.testing.assert_allclose(pixels, truth, rtol=0.02, atol=4e-3)

    def test_what_maps_cannot_hold_is_said(self, data_folder: Path, tmp_path: Path):
        """A paint whose highlight turns from green to violet as light and eye part."""
        th, td, _ = merl.grid_angles().numpy().transpose(3, 0, 1, 2)
        phase = 9 * np.cos(td)[..., None] + (0.0, 2.1, 4.2)
        flakes = 0.5 * (1 + np.cos(phase)) * np.exp(-(1 - np.cos(th)) / 0.06)[..., None]
        source = tmp_path / "paint.binary"
        merl.write(source, 0.01 + 0.6 * flakes)
        report = run(source, tmp_path / "out", frames=2, onset="none")
        assert 15 < report["measured_db"]["fit"] < 30
        assert any("show this measurement" in said for said in report["warnings"])

    def test_and_as_a_texture_where_it_is_to_spread(self, merl_file: Path, tmp_path: Path):
        report = run(merl_file, tmp_path / "out", frames=2, size=24)
        assert report["size"] == [24, 24]
