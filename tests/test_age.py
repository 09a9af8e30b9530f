"""What aging writes, end to end, with the bundled rust model on small inputs.

Nothing here depends on what the model has learned, except that steel rusts.
"""

from __future__ import annotations

import hashlib
import json
import math
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from model_runtime import __version__, cli
from model_runtime.age import AgeRequest
from model_runtime.contract import LADDER
from model_runtime.errors import Cancelled, InputError, ModelFileError, OutputError
from model_runtime.images import read_image
from model_runtime.model_files.weights import ENCODER, ESTIMATOR, find_model
from model_runtime.output import stored
from model_runtime.request import request_from
from tests.aging import (
    PRINCIPLED,
    TORRANCE_SPARROW,
    Listener,
    contents,
    frames_of,
    halves,
    run,
    write_painted_steel,
    write_torrance_sparrow,
)

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Aged:
    source: Path
    folder: Path
    report: dict[str, Any]
    listener: Listener

    def frames(self, name: str) -> np.ndarray:
        return frames_of(self.folder, name, self.report["frames"])


@pytest.fixture(scope="module")
def painted(place: Path, paint: Path) -> Aged:
    """The painted steel aged with all defaults, but for 12 frames."""
    listener = Listener()
    report = run(paint, place / "painted", listener, frames=12)
    return Aged(paint, place / "painted", report, listener)


class TestPrincipled:
    def test_every_file_that_is_listed_exists_and_no_other(self, painted: Aged):
        files = painted.report["files"]
        assert tuple(files) == (*PRINCIPLED, "height")
        for name in files:
            assert files[name] == [f"{name}_{k:04d}.exr" for k in range(1, 13)]
        listed = {file for names in files.values() for file in names}
        assert set(contents(painted.folder)) == listed | {"aged.json"}

    def test_shapes_and_channels(self, painted: Aged):
        import OpenEXR

        for name in PRINCIPLED:
            file = OpenEXR.File(str(painted.folder / f"{name}_0007.exr"), separate_channels=True)
            channels = file.channels()
            expected = {"R", "G", "B"} if name == "base_color" else {"Y"}
            assert set(channels) == expected
            for channel in channels.values():
                assert channel.pixels.shape == (64, 64)
                assert channel.pixels.dtype == np.float16

    def test_frame_1_is_the_input_to_the_last_texel(self, painted: Aged):
        first = {name: painted.frames(name)[0] for name in PRINCIPLED}
        for name, file in (
            ("base_color", "BaseColor"),
            ("metallic", "Metallic"),
            ("roughness", "Roughness"),
        ):
            source = read_image(painted.source / f"{file}.exr", color=name == "base_color")
            np.testing.assert_array_equal(first[name], halves(source))
        assert (first["specular"] == 0.5).all()

    def test_values_can_be_rendered(self, painted: Aged):
        for name in PRINCIPLED:
            values = painted.frames(name)
            assert np.isfinite(values).all()
            assert values.min() >= 0
            assert values.max() <= 1

    def test_it_rusts(self, painted: Aged):
        """At the end the material is redder, rougher and less metallic than it was."""
        base, metallic, roughness = (
            painted.frames(name)[[0, -1]] for name in ("base_color", "metallic", "roughness")
        )
        ratio = base[..., 0].mean((1, 2)) / base[..., 2].mean((1, 2))
        assert ratio[1] > 1.5 * ratio[0]
        assert metallic[1].mean() < metallic[0].mean()
        assert roughness[1].mean() > roughness[0].mean()

    def test_progress_rises_to_1_and_names_its_stages(self, painted: Aged):
        fractions = painted.listener.fractions
        assert fractions[0] == 0
        assert fractions[-1] == pytest.approx(1)
        assert set(painted.listener.stages) == {"reading", "modeling the change", "writing"}


class TestReport:
    CONTRACT = (
        "format ntm frames times size quality temporal_model palette fit_error warnings seconds "
        "peak_rss_mb files version command seed onset tolerance device hashes"
    )

    def test_it_holds_the_contract_s_fields(self, painted: Aged):
        report = painted.report
        for name in self.CONTRACT.split():
            assert name in report, name
        assert report == json.loads((painted.folder / "aged.json").read_text(encoding="utf-8"))
        assert report["format"] == "principled"
        assert report["ntm"] == "rust"
        assert report["frames"] == 12
        np.testing.assert_allclose(report["times"], np.arange(12) / 11, atol=1e-6)
        assert report["size"] == [64, 64]
        assert (report["quality"], report["onset"], report["seed"]) == ("balanced", "auto", 0)
        assert report["tolerance"] == 45
        assert report["temporal_model"] in LADDER
        assert 1 <= report["palette"] <= 64 * 64
        assert report["warnings"] == painted.listener.warnings
        assert all(seconds >= 0 for seconds in report["seconds"].values())
        assert 50 < report["peak_rss_mb"] < 10_000
        assert report["version"] == __version__
        assert report["device"] == "cpu"

    def test_hashes_are_those_of_the_files(self, painted: Aged):
        def sha256(path: Path) -> str:
            return hashlib.sha256(path.read_bytes()).hexdigest()

        hashes = painted.report["hashes"]
        assert hashes["ntm"] == sha256(find_model("rust"))
        assert hashes["encoder"] == sha256(ENCODER)
        assert hashes["estimator"] == sha256(ESTIMATOR)
        assert hashes["input"] == {path.name: sha256(path) for path in painted.source.iterdir()}

    def test_the_command_asks_for_the_same_again(self, painted: Aged):
        words = shlex.split(painted.report["command"])
        assert words[:4] == ["python", "-m", "model_runtime", "age"]
        fields = vars(cli._parser().parse_args(words[3:]))
        own = ("run", "json", "cache", "cache_gb")  # the command's, and no part of a request
        request = request_from({k: v for k, v in fields.items() if k not in own})
        assert request == AgeRequest(painted.source, "rust", painted.folder, frames=12)


def test_another_process_gives_the_same_files_to_the_bit(painted: Aged, tmp_path: Path):
    """Through the command line, from the recorded command.  What its parent holds, 2 GB here, is no
    part of its own peak memory.
    """
    words = shlex.split(painted.report["command"])[1:]
    ballast = np.ones(250_000_000)
    words[words.index("--output") + 1] = str(tmp_path / "again")
    done = subprocess.run(
        [sys.executable, *words, "--json"], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    again = contents(tmp_path / "again")
    assert json.loads(done.stdout) == json.loads(again["aged.json"])
    assert json.loads(again.pop("aged.json"))["peak_rss_mb"] < ballast.nbytes / 2e6
    before = contents(painted.folder)
    del before["aged.json"]
    assert again == before


class TestFormats:
    @pytest.mark.parametrize("name", ["torrance-sparrow", "principled-exact", "principled"])
    def test_the_same_material_in_each_format(self, tmp_path: Path, name: Any):
        """Base color (.5 .25 .1), metallic .4, level .5 by Kd = .6 base, Ks = .4 base + .024."""
        kd, ks = (0.3, 0.15, 0.06), (0.224, 0.124, 0.064)
        source = write_torrance_sparrow(tmp_path / "in", kd, ks, 0.25, 8)
        report = run(source, tmp_path / "out", frames=2, format=name)
        assert report["format"] == name
        assert report["warnings"] == []
        first = {m: frames_of(tmp_path / "out", m, 2)[0][3, 4] for m in report["files"]}
        if name == "torrance-sparrow":
            assert tuple(first) == (*TORRANCE_SPARROW, "height")
            expected = {"kd": kd, "ks": ks, "alpha": 0.25}
        elif name == "principled-exact":  # Kd / (1 - 0.224), Ks / 0.8, sqrt(alpha)
            assert tuple(first) == ("base_color", "specular_tint", "roughness", "height")
            expected = {
                "base_color": (0.386598, 0.193299, 0.0773196),
                "specular_tint": (0.28, 0.155, 0.08),
                "roughness": 0.5,
            }
        else:
            assert tuple(first) == (*PRINCIPLED, "height")
            m, base, level = (first[k] for k in ("metallic", "base_color", "specular"))
            np.testing.assert_allclose(base * (1 - m), kd, rtol=0.01)
            np.testing.assert_allclose(m * base + (1 - m) * 0.08 * level, ks, rtol=0.01)
            expected = {"roughness": 0.5}
        for m, value in expected.items():
            np.testing.assert_allclose(first[m], value, rtol=1e-3, err_msg=m)

    def test_a_bright_metal_cannot_be_exact_and_says_so(self, tmp_path: Path):
        source = write_torrance_sparrow(tmp_path / "gold", (0, 0, 0), (0.95, 0.7, 0.3), 0.1, 4)
        listener = Listener()
        report = run(source, tmp_path / "out", listener, frames=2, format="principled-exact")
        assert report["format"] == "torrance-sparrow"
        assert tuple(report["files"]) == (*TORRANCE_SPARROW, "height")
        assert any("0.8" in warning for warning in report["warnings"])
        assert listener.warnings == report["warnings"]

    def test_defaults(self, paint: Path, steel: Path, tmp_path: Path):
        assert run(paint, tmp_path / "a", frames=1, size=8)["format"] == "principled"
        assert run(steel, tmp_path / "b", frames=1, size=8)["format"] == "torrance-sparrow"

    def test_mono_specular_has_no_color(self, tmp_path: Path):
        source = write_torrance_sparrow(tmp_path / "in", ks=(0.6, 0.4, 0.2), size=8)
        run(source, tmp_path / "out", frames=3, specular="mono")
        ks = frames_of(tmp_path / "out", "ks", 3)
        np.testing.assert_array_equal(ks[..., 0], ks[..., 1])
        np.testing.assert_array_equal(ks[..., 0], ks[..., 2])
        np.testing.assert_allclose(ks[0], 0.4, rtol=1e-3)


class TestFrames:
    @pytest.mark.parametrize("frames", [1, 2, 50])
    def test_any_number(self, painted: Aged, paint: Path, tmp_path: Path, frames: int):
        report = run(paint, tmp_path / "out", frames=frames, size=16)
        assert len(report["times"]) == frames
        base = frames_of(tmp_path / "out", "base_color", frames)
        assert base.shape == (frames, 16, 16, 3)
        assert report["times"][0] == 0
        if frames > 1:
            assert report["times"][-1] == 1
            assert np.abs(base[-1] - base[0]).mean() > 0.01

    def test_the_same_times_look_the_same_whatever_the_number(self, paint: Path, tmp_path: Path):
        run(paint, tmp_path / "few", frames=3, size=16)
        run(paint, tmp_path / "many", frames=7, size=16)
        for name in PRINCIPLED:
            few, many = frames_of(tmp_path / "few", name, 3), frames_of(tmp_path / "many", name, 7)
            np.testing.assert_array_equal(few, many[::3])

    def test_a_shorter_result_replaces_a_longer_one(self, paint: Path, tmp_path: Path):
        run(paint, tmp_path / "out", frames=4, size=8)
        (tmp_path / "out" / "mine.txt").write_text("mine")
        report = run(paint, tmp_path / "out", frames=2, size=8)
        listed = {file for files in report["files"].values() for file in files}
        assert set(contents(tmp_path / "out")) == listed | {"aged.json", "mine.txt"}


class TestFailures:
    @pytest.mark.parametrize("stop_at", [1, 2, 5])
    def test_cancelling_leaves_the_earlier_result(self, paint: Path, tmp_path: Path, stop_at: int):
        run(paint, tmp_path / "out", frames=2, size=8)
        before = contents(tmp_path / "out")
        with pytest.raises(Cancelled):
            run(paint, tmp_path / "out", Listener(stop_at=stop_at), frames=9, size=16)
        assert contents(tmp_path / "out") == before
        assert [path.name for path in tmp_path.iterdir()] == ["out"]

    def test_cancelling_the_first_run_leaves_nothing(self, paint: Path, tmp_path: Path):
        with pytest.raises(Cancelled):
            run(paint, tmp_path / "out", Listener(stop_at=4), frames=9, size=16)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("value", [math.nan, math.inf, -0.5])
    def test_maps_that_make_no_sense(self, tmp_path: Path, value: float):
        source = write_painted_steel(tmp_path / "in", 8)
        rough = np.full((8, 8), 0.5, np.float32)
        # write_exr clamps what is infinite
        import OpenEXR

        rough[3, 4] = value
        header = {"type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"Y": rough}).write(str(source / "Roughness.exr"))
        with pytest.raises(InputError, match=r"Roughness\.exr .*row 3, column 4"):
            run(source, tmp_path / "out", frames=2)
        assert not (tmp_path / "out").exists()

    def test_no_input(self, tmp_path: Path):
        with pytest.raises(InputError):
            run(tmp_path / "none", tmp_path / "out", frames=2)

    def test_no_such_model(self, steel: Path, tmp_path: Path):
        with pytest.raises(ModelFileError, match=r"'rost'.*rust"):
            run(steel, tmp_path / "out", ntm="rost", frames=2)

    def test_a_truncated_model(self, steel: Path, tmp_path: Path):
        path = tmp_path / "half.safetensors"
        path.write_bytes(find_model("rust").read_bytes()[:-100])
        with pytest.raises(ModelFileError, match="truncated"):
            run(steel, tmp_path / "out", ntm=str(path), frames=2)

    def test_a_file_where_the_output_should_be(self, steel: Path, tmp_path: Path):
        (tmp_path / "out").write_text("mine")
        with pytest.raises(OutputError, match="is a file"):
            run(steel, tmp_path / "out", frames=2, onset="none")
        assert (tmp_path / "out").read_text() == "mine"

    def test_a_full_disk(self, paint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        import shutil

        run(paint, tmp_path / "out", frames=2, size=8)
        before = contents(tmp_path / "out")
        usage = shutil._ntuple_diskusage(1 << 30, 1 << 30, 1000)
        monkeypatch.setattr(stored.shutil, "disk_usage", lambda _: usage)
        with pytest.raises(OutputError, match="MB"):
            run(paint, tmp_path / "out", frames=2, size=16)
        assert contents(tmp_path / "out") == before

    def test_files_that_no_run_has_written_are_refused_before_the_work(
        self, paint: Path, tmp_path: Path
    ):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "metallic_0002.exr").write_bytes(b"mine")
        listener = Listener()
        with pytest.raises(OutputError, match=r"metallic_0002\.exr, which no run has written"):
            run(paint, tmp_path / "out", listener, frames=2, size=8)
        assert set(listener.stages) == {"reading"}
        assert contents(tmp_path / "out") == {"metallic_0002.exr": b"mine"}


class TestInputThatChanges:
    """While the run goes on."""

    @dataclass
    class Meddler(Listener):
        """Does something to the input once the modeling has begun."""

        meddle: Callable[[], object] = lambda: None

        def progress(self, stage: str, fraction: float) -> None:
            if stage != "reading" and "modeling the change" not in self.stages:
                self.meddle()
            super().progress(stage, fraction)

    @pytest.fixture
    def source(self, tmp_path: Path) -> Path:
        return write_painted_steel(tmp_path / "in", 8)

    def test_the_report_has_the_hashes_of_what_was_read(self, source: Path, tmp_path: Path):
        hashes = {name: hashlib.sha256(data).hexdigest() for name, data in contents(source).items()}
        model = tmp_path / "own.safetensors"
        model.write_bytes(find_model("rust").read_bytes())

        def replace() -> None:
            other = write_painted_steel(tmp_path / "other", 16)
            for path in other.iterdir():
                path.replace(source / path.name)
            model.write_bytes(b"")

        report = run(source, tmp_path / "out", self.Meddler(meddle=replace), ntm=str(model))
        assert report["hashes"]["input"] == hashes
        rust = hashlib.sha256(find_model("rust").read_bytes()).hexdigest()
        assert report["hashes"]["ntm"] == rust

    def test_one_that_is_deleted_costs_no_work(self, source: Path, tmp_path: Path):
        meddler = self.Meddler(meddle=lambda: shutil.rmtree(source))
        report = run(source, tmp_path / "out", meddler, frames=2)
        assert not source.exists()
        assert len(report["hashes"]["input"]) == 3

    @pytest.mark.parametrize("keeps_times", [False, True])
    def test_one_that_is_replaced_while_it_is_read_is_said(
        self, source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keeps_times: bool
    ):
        """Also by a file of the same length and date."""
        from model_runtime.modelling import start

        def read_and_replace(path: Path, **options: Any):
            material = read_input(path, **options)
            other = write_painted_steel(tmp_path / "other", 8) / "Metallic.exr"
            if keeps_times:
                shutil.copystat(path / "Metallic.exr", other)
            other.replace(path / "Metallic.exr")
            return material

        read_input = start.read_input
        monkeypatch.setattr(start, "read_input", read_and_replace)
        with pytest.raises(InputError, match=r"Metallic\.exr changed while it was read"):
            run(source, tmp_path / "out", frames=2)
        assert not (tmp_path / "out").exists()
