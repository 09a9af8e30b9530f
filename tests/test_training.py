"""Training: a run that was killed ends as one that was not, and leaves a file that can be used.

Recipes are cut down to a second. A clock that runs fast makes checkpoints frequent.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

import training.__main__ as command
from model_runtime.errors import InputError, ModelFileError, OutputError, UsageError
from model_runtime.images import write_exr
from model_runtime.maps import TorranceSparrowMaps
from model_runtime.model_files.weights import ENCODER, read_card
from model_runtime.representation import load_representation
from model_runtime.temporal.models import Affine
from model_runtime.temporal.ntm import LADDER, NeuralTemporalModel
from tests.ageing import run, write_torrance_sparrow
from training import encoder, ntm
from training.checkpoint import DivergedError, save_checkpoint
from training.data import weathering
from training.data.synthetic import s2
from training.encoder import CONFIGS, train_encoder
from training.ntm import NTMConfig, train_ntm

pytestmark = pytest.mark.usefixtures("one_thread")

ROOT = Path(__file__).resolve().parents[1]
CARD = {
    "name": "moss",
    "title": "Moss",
    "description": "Grows",
    "process": "rust",
    "source": "made up",
    "license": "CC0-1.0",
}
TINY = NTMConfig(iterations=12, batch=32, warm_up=3)


class Killed(BaseException):
    """The end of the process: nothing catches it."""


def fast_clock(step: float) -> SimpleNamespace:
    """Every look at it is `step` seconds after the last."""
    now = iter(range(10**9))
    return SimpleNamespace(monotonic=lambda: next(now) * step, process_time=time.process_time)


@pytest.fixture
def interrupted(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Calls something with checkpoints every three steps, killed before the n-th is written."""

    def kill(module, at: int, task: Callable[[], object]) -> None:
        count = iter(range(1, 10**9))

        def save(*args, **keywords) -> None:
            if next(count) == at:
                raise Killed
            save_checkpoint(*args, **keywords)

        with monkeypatch.context() as patch:
            patch.setattr(module, "time", fast_clock(21))
            patch.setattr(module, "save_checkpoint", save)
            with pytest.raises(Killed):
                task()

    return kill


def small(name: str, **changes) -> encoder.EncoderConfig:
    """A recipe of a second, otherwise as `name`."""
    sizes = {"iterations": 14, "batch": 8, "targets": 16, "warm_up": 3, "looks": 0}
    sizes["distillation"] = 2
    if name == "paper":
        sizes["samples"] = 12
    return replace(CONFIGS[name], **sizes | changes)


def equal(one: Path, other: Path) -> bool:
    a, b = load_file(one), load_file(other)
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


class TestEncoder:
    @pytest.mark.parametrize("name", ["fast", "paper"])
    def test_killed_and_resumed_it_ends_as_it_would_have(
        self, data_folder, tmp_path, monkeypatch, interrupted, name
    ):
        monkeypatch.setitem(CONFIGS, name, small(name))
        whole, parts = tmp_path / "whole.safetensors", tmp_path / "parts.safetensors"
        train_encoder(config=name, output=whole, seed=3)
        for at in (2, 2):  # killed twice: a checkpoint further each time
            interrupted(
                encoder,
                at,
                lambda: train_encoder(config=name, output=parts, seed=3, resume=True),
            )
            assert not parts.exists()
        torch.rand(5)  # whatever random numbers are drawn meanwhile
        train_encoder(config=name, output=parts, seed=3, resume=True)
        assert equal(whole, parts)

    def test_the_file_is_an_encoder_with_a_card(self, data_folder, tmp_path, monkeypatch):
        monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
        path = train_encoder(config="fast", output=tmp_path / "new" / "e.safetensors", seed=7)
        model, identity = load_representation(path)
        assert model.name == "lobes"
        assert len(identity) == 16
        card = read_card(path)
        assert card.kind == "encoder"
        assert card.trained["seed"] == 7
        assert card.trained["iterations"] == 2
        assert card.trained["config"]["batch"] == 8
        assert {"alum-bronze", "steel"} <= set(card.trained["held_out"])
        assert "MERL" in card.source

    def test_seeds_matter_and_repeat(self, data_folder, tmp_path, monkeypatch):
        monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
        one, same, other = (
            train_encoder(config="fast", output=tmp_path / f"{k}.safetensors", seed=seed)
            for k, seed in enumerate((1, 1, 2))
        )
        assert equal(one, same)
        assert not equal(one, other)

    def test_minutes_set_the_number_of_iterations(self, data_folder, tmp_path, monkeypatch):
        monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=10**6))
        path = train_encoder(config="fast", output=tmp_path / "e.safetensors", minutes=1e-3)
        assert 1 <= read_card(path).trained["iterations"] < 10_000

    def test_without_resume_it_starts_again(self, data_folder, tmp_path, monkeypatch):
        monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
        path = train_encoder(config="fast", output=tmp_path / "e.safetensors", seed=1)
        train_encoder(config="fast", output=path, seed=2)
        fresh = train_encoder(config="fast", output=tmp_path / "f.safetensors", seed=2)
        assert equal(path, fresh)

    def test_a_damaged_checkpoint_is_a_sentence(self, data_folder, tmp_path, monkeypatch):
        monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
        (tmp_path / "e.checkpoint.safetensors").write_bytes(b"rubbish")
        with pytest.raises(ModelFileError, match="cannot be read") as error:
            train_encoder(config="fast", output=tmp_path / "e.safetensors", resume=True)
        assert "without --resume" in error.value.hint

    def test_so_is_another_recipe_s(self, data_folder, tmp_path, monkeypatch):
        for name in ("fast", "paper"):
            monkeypatch.setitem(CONFIGS, name, small(name, iterations=2))
        train_encoder(config="paper", output=tmp_path / "e.safetensors")
        with pytest.raises(UsageError, match="other settings"):
            train_encoder(config="fast", output=tmp_path / "e.safetensors", resume=True)

    def test_so_is_another_seed_s(self, data_folder, tmp_path, monkeypatch):
        monkeypatch.setitem(CONFIGS, "fast", small("fast", iterations=2))
        train_encoder(config="fast", output=tmp_path / "e.safetensors", seed=1)
        with pytest.raises(UsageError, match="other settings"):
            train_encoder(config="fast", output=tmp_path / "e.safetensors", resume=True, seed=2)

    @pytest.mark.slow
    def test_killed_by_the_system(self, data_folder, tmp_path, monkeypatch):
        """kill -9 at whatever moment: the checkpoint is whole and the end is the same."""
        recipe = small("fast", iterations=60)
        monkeypatch.setitem(CONFIGS, "fast", recipe)
        code = (
            "import sys, torch\n"
            "from pathlib import Path\n"
            "from dataclasses import replace\n"
            "from tests.test_training import fast_clock, small\n"
            "from training import encoder\n"
            "torch.set_num_threads(1)\n"
            "encoder.time = fast_clock(61)\n"
            "encoder.CONFIGS['fast'] = small('fast', iterations=60)\n"
            "encoder.train_encoder(config='fast', output=Path(sys.argv[1]), seed=5)\n"
        )
        output = tmp_path / "killed.safetensors"
        checkpoint = tmp_path / "killed.checkpoint.safetensors"
        child = subprocess.Popen(
            [sys.executable, "-c", code, str(output)], cwd=ROOT, stderr=subprocess.DEVNULL
        )
        try:
            deadline = time.monotonic() + 120
            while not checkpoint.exists() and time.monotonic() < deadline:
                time.sleep(0.02)
            time.sleep(0.3)
        finally:
            os.kill(child.pid, signal.SIGKILL)
            child.wait()
        with safe_open(checkpoint, framework="pt") as stored:
            step = json.loads(stored.metadata()["record"])["step"]
        assert step >= 1
        train_encoder(config="fast", output=output, seed=5, resume=True)
        whole = train_encoder(config="fast", output=tmp_path / "whole.safetensors", seed=5)
        assert equal(whole, output)


@pytest.fixture(scope="module")
def rusting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sequences") / "rust"
    weathering.write("rust", folder, size=24, frames=6)
    return folder


def train(sequence: Path, output: Path, **options) -> Path:
    options = {"config": TINY, "card": CARD, "encoder": ENCODER} | options
    return train_ntm(sequence=sequence, output=output, **options)


class TestNTM:
    def test_the_file_carries_the_contract_s_card_and_can_be_used(self, rusting, tmp_path):
        path = train(rusting, tmp_path / "new folder" / "moss.safetensors", seed=4)
        card = read_card(path)
        contract = "format version name title description process frames representation domain"
        for name in (*contract.split(), "source", "license", "trained"):
            assert name in card.details, name
        for name in ("name", "title", "description", "process", "license"):
            assert card.details[name] == CARD[name]
        assert CARD["source"] in card.source
        assert card.frames == 6
        assert card.representation == load_representation()[1]
        assert all(low <= high for low, high in card.domain["ranges"].values())
        assert card.trained["seed"] == 4
        ladder = card.details["ladder"]
        assert set(ladder) == set(LADDER)
        assert all(set(scores) == {"texels", "above", "below"} for scores in ladder.values())

        model = NeuralTemporalModel.load(path, card.representation)
        assert model.chosen in LADDER
        first = weathering.generate("rust", size=24, frames=6)
        kd, ks, alpha = first.kd[0], first.ks[0], first.alpha[0]
        flat = np.concatenate((kd, ks, alpha[..., None]), -1).reshape(-1, 7)
        assert float(model.domain.outside(torch.from_numpy(flat)).float().mean()) < 0.05

        source = write_torrance_sparrow(tmp_path / "steel", size=4)
        report = run(source, tmp_path / "out", ntm=str(path), frames=3)
        assert report["ntm"] == "moss"

    def test_killed_and_resumed_it_ends_as_it_would_have(self, rusting, tmp_path, interrupted):
        whole = train(rusting, tmp_path / "whole.safetensors", seed=2)
        output = tmp_path / "parts.safetensors"
        for at in (2, 3, 4, 4, 2):  # in both LSTMs, then in those that hold out ranges
            interrupted(ntm, at, lambda: train(rusting, output, seed=2, resume=True))
            assert not output.exists()
        train(rusting, output, seed=2, resume=True)
        assert equal(whole, output)

    def test_a_damaged_checkpoint_is_a_sentence(self, rusting, tmp_path):
        (tmp_path / "moss.parameters.checkpoint.safetensors").write_bytes(bytes(100))
        with pytest.raises(ModelFileError, match="cannot be read"):
            train(rusting, tmp_path / "moss.safetensors", resume=True)

    def test_what_is_affine_gets_the_affine_model(self, tmp_path):
        """The simplest model that suffices is chosen, and the card says how the others did."""
        rng = np.random.default_rng(0)
        kd, ks = rng.uniform(0.2, 0.6, (2, 12, 12, 3)).astype(np.float32)
        alpha = rng.uniform(0.1, 0.3, (12, 12)).astype(np.float32)
        sequence = s2(TorranceSparrowMaps(kd, ks + 0.2, alpha), 0.4, frames=5)
        write_sequence(tmp_path / "s2", sequence.kd, sequence.ks, sequence.alpha)
        path = train(tmp_path / "s2", tmp_path / "moss.safetensors")
        card = read_card(path)
        assert card.details["temporal_model"] == "affine"
        ladder = card.details["ladder"]
        assert all(psnr > 45 for psnr in ladder["affine"].values())
        assert all(psnr < 45 for psnr in ladder["constant"].values())
        assert set(ladder["lstm_latents"]) == {"texels"}, "what is not needed is not trained"
        assert not list(tmp_path.glob("*.above.*"))

    def test_what_stays_gets_the_constant(self, tmp_path):
        rng = np.random.default_rng(0)
        kd, ks = rng.uniform(0.2, 0.6, (2, 12, 12, 3)).astype(np.float32)
        still = [np.repeat(m[None], 4, 0) for m in (kd, ks, np.full((12, 12), 0.2, np.float32))]
        write_sequence(tmp_path / "still", *still)
        path = train(tmp_path / "still", tmp_path / "moss.safetensors")
        assert read_card(path).details["temporal_model"] == "constant"

    def test_a_folder_without_a_sequence(self, tmp_path):
        with pytest.raises(InputError, match="holds no sequence"):
            train(tmp_path, tmp_path / "moss.safetensors")

    def test_a_checkpoint_that_is_no_number_replaces_no_model(self, rusting, tmp_path):
        output = train(rusting, tmp_path / "moss.safetensors")
        good = output.read_bytes()
        checkpoint = tmp_path / "moss.latents.checkpoint.safetensors"
        spoil(checkpoint)
        with pytest.raises(ModelFileError, match="not finite"):
            train(rusting, output, resume=True)
        assert output.read_bytes() == good

    def test_nor_does_a_training_whose_values_are_none(self, rusting, tmp_path, monkeypatch):
        output = train(rusting, tmp_path / "moss.safetensors")
        good = output.read_bytes()

        def fit(histories, observed):
            return Affine(*torch.full((2, histories.shape[1], 7), torch.inf))

        monkeypatch.setattr(ntm.Affine, "fit", fit)
        with pytest.raises(ModelFileError, match="not finite"):
            train(rusting, output)
        assert output.read_bytes() == good
        assert not list(tmp_path.glob(".*"))

    def test_a_training_that_diverges_says_so(self, rusting, tmp_path):
        output = tmp_path / "moss.safetensors"
        with pytest.raises(DivergedError):
            train(rusting, output, config=replace(TINY, learning_rate=float("inf")))
        assert not list(tmp_path.glob("*.safetensors"))

    @pytest.mark.parametrize("what", ["output", "checkpoint", "log", "parent"])
    def test_what_cannot_be_written_is_known_before(self, rusting, tmp_path, monkeypatch, what):
        output = tmp_path / "new" / "moss.safetensors"
        if what == "parent":
            (tmp_path / "new").write_text("in the way")
        elif what == "log":
            (tmp_path / "new").mkdir()
            output.with_suffix(".tensorboard").write_text("in the way")
        else:
            ending = ".safetensors" if what == "output" else ".parameters.checkpoint.safetensors"
            output.with_suffix(ending).mkdir(parents=True)
        monkeypatch.setattr(ntm.tqdm, "__iter__", None)  # no step is taken
        with pytest.raises(OutputError, match="cannot be written"):
            train(rusting, output)

    @pytest.mark.parametrize(
        ("field", "value"),
        [
            ("name", ""),
            ("title", "\x1b[2J"),
            ("description", "half \ud800"),
            ("source", "x" * 900_000),
            ("process", "x" * 900),
        ],
    )
    def test_a_card_that_nobody_could_read_is_refused_before(self, rusting, tmp_path, field, value):
        with pytest.raises(UsageError, match=f"its {field} ") as error:
            train(rusting, tmp_path / "moss.safetensors", card=CARD | {field: value})
        assert str(error.value).isprintable()
        assert not list(tmp_path.iterdir())

    def test_a_folder_of_any_name_can_be_learned_from(self, rusting, tmp_path):
        folder = tmp_path / "se\x1bquence \udce9"
        folder.symlink_to(rusting)
        path = train(folder, tmp_path / "moss.safetensors")
        assert "quence" in read_card(path).trained["command"]

    def test_a_missing_encoder(self, rusting, tmp_path):
        with pytest.raises(ModelFileError, match="no model file"):
            train(rusting, tmp_path / "moss.safetensors", encoder=tmp_path / "none.safetensors")


def spoil(checkpoint: Path) -> None:
    """Write NaN into the first of the model's weights."""
    with safe_open(checkpoint, framework="pt") as stored:
        record = stored.metadata()
    content = load_file(checkpoint)
    name = min(name for name in content if name.startswith("model."))
    content[name].view(-1)[0] = torch.nan
    save_file(content, checkpoint, record)


def write_sequence(folder: Path, kd: np.ndarray, ks: np.ndarray, alpha: np.ndarray) -> None:
    folder.mkdir()
    for name, maps in (("kd", kd), ("ks", ks), ("alpha", alpha)):
        for k, pixels in enumerate(maps, start=1):
            write_exr(folder / f"{name}_{k:04d}.exr", np.ascontiguousarray(pixels))


class TestCommand:
    def call(self, monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> int | str | None:
        monkeypatch.setattr(sys, "argv", ["training", *map(str, words)])
        try:
            return command.main()
        except SystemExit as ended:
            return ended.code

    @pytest.mark.parametrize(
        "words",
        [
            ["encoder"],
            ["encoder", "--output", "x", "--config", "huge"],
            ["encoder", "--output", "x", "--minutes", "many"],
            ["ntm", "--sequence", "x", "--output", "y"],
            ["sing"],
            ["evaluate", "everything", "--output", "x"],
        ],
        ids=" ".join,
    )
    def test_wrong_usage_is_exit_code_2(self, monkeypatch, tmp_path, capsys, words):
        monkeypatch.chdir(tmp_path)
        assert self.call(monkeypatch, *words) == 2
        assert list(tmp_path.iterdir()) == []

    def test_a_failure_is_one_sentence_and_exit_code_1(self, monkeypatch, tmp_path, capsys):
        words = ["ntm", "--sequence", tmp_path / "none", "--encoder", ENCODER, "--name", "moss"]
        code = self.call(monkeypatch, *words, "--output", tmp_path / "moss.safetensors")
        assert code == 1
        said = capsys.readouterr().err
        assert "There is no folder" in said
        assert "Traceback" not in said

    @pytest.mark.parametrize("seed", ["-1", str(1 << 64)])
    def test_a_seed_out_of_range(self, monkeypatch, tmp_path, capsys, seed: str):
        words = ["weathering", "rust", "--output", tmp_path / "s", "--seed", seed]
        assert self.call(monkeypatch, *words) == 2
        assert "seed" in capsys.readouterr().err
        assert not list(tmp_path.iterdir())

    def test_the_system_s_errors_are_a_sentence_too(self, monkeypatch, tmp_path, capsys):
        def fail(*args, **options):
            raise OSError(28, "No space left on device", "/a/b")

        monkeypatch.setattr(weathering, "write", fail)
        words = ["weathering", "rust", "--output", tmp_path / "s"]
        assert self.call(monkeypatch, *words) == 1
        assert capsys.readouterr().err == "/a/b: No space left on device.\n"

    def test_ctrl_c_is_exit_code_130_and_keeps_the_checkpoint(self, rusting, tmp_path):
        """While the second LSTM is trained: the first has its checkpoint."""
        output = tmp_path / "moss.safetensors"
        checkpoint = tmp_path / "moss.parameters.checkpoint.safetensors"
        words = ["ntm", "--sequence", rusting, "--encoder", ENCODER, "--output", output]
        child = subprocess.Popen(
            [sys.executable, "-m", "training", *map(str, words), "--name", "x", "--minutes", "0.1"],
            cwd=ROOT,
            stderr=subprocess.PIPE,
            text=True,
            # Tests may run in the background, whose children would not hear it.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        try:
            deadline = time.monotonic() + 120
            while not checkpoint.exists() and time.monotonic() < deadline:
                time.sleep(0.02)
            child.send_signal(signal.SIGINT)
            _, said = child.communicate(timeout=60)
        finally:
            child.kill()
        assert child.returncode == 130
        assert "--resume" in said.splitlines()[-1]
        assert "Traceback" not in said
        assert load_file(checkpoint)
        assert not output.exists()
        assert not list(tmp_path.glob(".*"))

    def test_a_missing_data_folder(self, monkeypatch, tmp_path, capsys):
        monkeypatch.setenv("TVBRDF_DATA", str(tmp_path / "none"))
        code = self.call(monkeypatch, "encoder", "--output", tmp_path / "e.safetensors")
        assert code == 1
        assert "TVBRDF_DATA" in capsys.readouterr().err

    @pytest.mark.parametrize("minutes", ["0", "-1", "nan", "inf", "1e300"])
    def test_no_time_is_no_training(self, monkeypatch, tmp_path, capsys, minutes: str):
        code = self.call(
            monkeypatch, "encoder", "--output", tmp_path / "e.safetensors", "--minutes", minutes
        )
        assert code == 2
        assert "minutes" in capsys.readouterr().err

    def test_weathering_writes_a_sequence(self, monkeypatch, tmp_path):
        words = ["weathering", "rust", "--output", tmp_path / "s", "--size", "8", "--frames", "3"]
        assert self.call(monkeypatch, *words) == 0
        assert len(list((tmp_path / "s").glob("kd_*.exr"))) == 3
