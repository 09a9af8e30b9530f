"""From a weathered material to a model in one command, with no more than what ships."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model_runtime.errors import Cancelled, InputError
from model_runtime.model_files.weights import read_card
from model_runtime.temporal.ntm import NeuralTemporalModel
from tests.scans import MadeScan, write_plain, write_scan
from training import learn as learning
from training.data.sequences import Sequence, read_sequence
from training.data.writing import write_sequence
from training.ntm import NTMConfig
from training.source.change import Change, sequence_of
from training.source.grain import grain_of
from training.source.residue import with_residue
from training.source.scan import change_of, read_states

ROOT = Path(__file__).resolve().parents[1]
ABSENT = ("scipy", "matplotlib", "tqdm", "rich", "tyro", "tensorboard", "torch.utils.tensorboard")
"""What Blender's worker does not have."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> MadeScan:
    return write_scan(tmp_path_factory.mktemp("scan") / "plate", side=128)


@pytest.fixture(scope="module")
def change(made: MadeScan) -> Change:
    return change_of(read_states(made.folder))


@pytest.fixture(scope="module")
def learned(made: MadeScan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("model") / "plate.safetensors"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(learning, "LEARNING", NTMConfig(iterations=3, batch=16, warm_up=1))
        learning.learn(
            made.folder,
            output,
            "plate",
            process="rust",
            sources=({"name": "plate", "license": "CC0-1.0", "credit": "nobody"},),
        )
    return output


def test_a_model_takes_clean_texels_to_what_is_weathered(learned: Path, change: Change):
    ntm = NeuralTemporalModel.load(learned, read_card(learned).representation)
    start = torch.from_numpy(change.mean[:1, :7].copy())
    start[:, 6] **= 2
    history = ntm.rung(ntm.chosen).rollout(start, ntm.frames)[0]
    expected = torch.from_numpy(change.mean[:, :7].copy())
    expected[:, 6] **= 2
    assert (history - expected).abs().max() < 0.01


def test_grain_and_height_and_credit_are_in_the_file(learned: Path, change: Change):
    card = read_card(learned)
    ntm = NeuralTemporalModel.load(learned, card.representation)
    assert card.version == 2
    assert card.details["sources"] == [{"name": "plate", "license": "CC0-1.0", "credit": "nobody"}]
    assert ntm.grain is not None
    assert ntm.height is not None
    assert ntm.height[0] == 0
    assert np.allclose(ntm.height.numpy(), change.mean[:, 7], atol=1e-4)
    assert "Learned from plate" in card.source
    assert learned.stat().st_size < 5e6
    assert not list(learned.parent.glob("*checkpoint*"))


def test_other_materials_of_the_process_are_its_own_too(learned: Path):
    ntm = NeuralTemporalModel.load(learned, read_card(learned).representation)
    paint = torch.tensor([[0.1, 0.3, 0.2, 0.04, 0.04, 0.04, 0.1]])
    assert not ntm.domain.outside(paint).any()


def test_nothing_to_learn_is_one_sentence_and_no_file(tmp_path: Path):
    with pytest.raises(InputError, match="no two states"):
        learning.learn(write_plain(tmp_path / "plain"), tmp_path / "m.safetensors", "plain")
    assert not (tmp_path / "m.safetensors").exists()


def test_who_listens_may_end_it(made: MadeScan, tmp_path: Path):
    def step(stage: str, fraction: float) -> None:
        if fraction > 0.16:
            raise Cancelled

    with pytest.raises(Cancelled):
        learning.learn(made.folder, tmp_path / "m.safetensors", "plate", step=step)
    assert not list(tmp_path.iterdir())


def test_a_sequence_is_read_as_it_was_written(change: Change, tmp_path: Path):
    sources = ({"name": "plate", "license": "CC0-1.0", "credit": "nobody"},)
    written = sequence_of(change, process="rust", sources=sources)
    write_sequence(written, tmp_path / "sequence", {})
    found = read_sequence(tmp_path / "sequence", clamp=False)
    assert isinstance(found, Sequence)
    assert found.sources == sources
    assert found.timing == written.timing
    assert found.share == written.share
    for name in ("kd", "alpha", "height", "residue", "strength"):
        one, other = getattr(written, name), getattr(found, name)
        assert np.allclose(one, other, atol=2e-3), name  # half floats


def test_a_material_that_is_covered_keeps_nothing_and_one_that_grays_keeps_its_figure(
    change: Change,
):
    covered, grayed = (
        sequence_of(change, process=process).kd[:, 0, 1024:]
        for process in ("rust", "weathered_wood")
    )
    assert covered[-1].std(0).max() < 1e-5
    assert grayed[-1].std(0).min() > 0.2 * grayed[0].std(0).min()


class TestGrain:
    def test_a_picture_s_own_last_frame_is_its_example(self):
        frames, side = 6, 64
        y, x = np.mgrid[:side, :side] / side * 2 * np.pi
        figure = (0.05 * np.sin(5 * x) * np.sin(4 * y)).astype(np.float32)
        time = np.linspace(0, 1, frames, dtype=np.float32)[:, None, None, None]
        kd = 0.3 - 0.1 * time + (time * figure[..., None])
        kd = np.broadcast_to(kd, (frames, side, side, 3)).copy()
        ks, alpha = np.full_like(kd, 0.04), np.full(kd.shape[:3], 0.25, np.float32)
        picture = Sequence(kd, ks, alpha, time.ravel(), None, "picture")
        residue = with_residue(picture).residue
        assert residue is not None
        assert residue[..., 0].std() == pytest.approx(figure.std(), rel=0.2)
        assert np.abs(residue[..., 3:]).max() < 1e-4
        shuffled = np.random.default_rng(0).permutation(side * side)
        mixed = kd.reshape(frames, -1, 3)[:, shuffled].reshape(kd.shape)
        assert with_residue(replace(picture, kd=mixed)).residue is None

    def test_it_differs_as_the_residue_does(self, change: Change):
        grain = grain_of(
            change.residue, change.mean[-1, :7], np.linspace(0, 1, 5, dtype=np.float32), 0.5
        )
        stored = grain.tile.reshape(len(grain.tile), -1)
        values = np.stack([table[each] for table, each in zip(grain.table, stored, strict=True)])
        assert np.allclose(values.mean(1), 0, atol=1e-3)
        assert np.allclose(values.std(1), 1, atol=1e-3)
        assert not grain.shapes[0].any()
        made = np.einsum("jn,jc->nc", values, grain.shapes[-1])
        own = change.residue.reshape(-1, 8)
        for channel in (0, 1, 6):
            assert np.corrcoef(made[:, channel], own[:, channel])[0, 1] > 0.95
            assert made[:, channel].std() == pytest.approx(own[:, channel].std(), rel=0.05)

    def test_nothing_that_differs_is_no_grain_at_all(self):
        flat = np.zeros((16, 16, 8), np.float32)
        grain = grain_of(flat, flat[0, 0, :7], np.ones(3, np.float32), 1.0)
        assert not grain.table.any()


def test_it_needs_no_library_that_does_not_ship():
    code = (
        "import sys\n"
        f"for name in {ABSENT}: sys.modules[name] = None\n"
        "import training.learn, training.learn_command\n"
        "sys.argv = ['training', 'learn', '--help']\n"
        "from training.__main__ import main\n"
        "sys.exit(main())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert "--process" in run.stdout


class TestCommand:
    def test_with_json_every_line_is_a_message(self, tmp_path: Path):
        run = self.run(write_plain(tmp_path / "plain"), tmp_path, "--json")
        lines = [json.loads(line) for line in run.stdout.splitlines()]
        assert lines[0]["type"] == "progress"
        assert lines[-1]["type"] == "error"
        assert "no two states" in lines[-1]["message"]
        assert run.returncode == 1

    def test_it_is_cancelled_by_a_line(self, made: MadeScan, tmp_path: Path):
        cancel = json.dumps({"id": 1, "verb": "cancel"}) + "\n"
        run = self.run(made.folder, tmp_path, "--json", said=cancel)
        last = json.loads(run.stdout.splitlines()[-1])
        assert (last["type"], last["code"]) == ("error", "cancelled")
        assert run.returncode == 3

    def test_for_people_it_is_one_sentence(self, tmp_path: Path):
        run = self.run(write_plain(tmp_path / "plain"), tmp_path)
        assert run.returncode == 1
        assert "no two states" in run.stderr
        assert "Traceback" not in run.stderr

    @staticmethod
    def run(source: Path, folder: Path, *words: str, said: str = "") -> subprocess.CompletedProcess:
        output = folder / "model.safetensors"
        command = [sys.executable, "-m", "training", "learn", source, "--output", output]
        return subprocess.run(
            [*map(str, command), "--name", "m", *words],
            cwd=ROOT,
            input=said,
            capture_output=True,
            text=True,
            check=False,
        )
