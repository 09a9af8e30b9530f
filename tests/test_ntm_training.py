"""Training a temporal model: one that was killed ends as one that was not, and can be used."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from tqdm import tqdm

from model_runtime.contract import LADDER
from model_runtime.errors import InputError, ModelFileError, OutputError, UsageError
from model_runtime.images import write_exr
from model_runtime.maps import TorranceSparrowMaps
from model_runtime.model_files.weights import ENCODER, read_card
from model_runtime.representation import load_representation
from model_runtime.temporal.models import Affine
from model_runtime.temporal.ntm import NeuralTemporalModel
from tests.aging import run, write_torrance_sparrow
from tests.trainings import CARD, equal, kill_at
from training import ntm
from training.checkpoint import DivergedError
from training.data import weathering
from training.data.synthetic import s2
from training.ntm import NTMConfig, train_ntm

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = NTMConfig(iterations=12, batch=32, warm_up=3)


def train(sequence: Path, output: Path, **options) -> Path:
    options = {"sequences": (sequence,), "config": TINY, "card": CARD, "encoder": ENCODER} | options
    return train_ntm(output=output, **options)


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


def test_the_file_carries_the_contract_s_card_and_can_be_used(rusting, tmp_path):
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


def test_killed_and_resumed_it_ends_as_it_would_have(rusting, tmp_path):
    whole = train(rusting, tmp_path / "whole.safetensors", seed=2)
    output = tmp_path / "parts.safetensors"
    for at in (2, 3, 4, 4, 2):  # in both LSTMs, then in those that hold out ranges
        kill_at(at, lambda: train(rusting, output, seed=2, resume=True))
        assert not output.exists()
    train(rusting, output, seed=2, resume=True)
    assert equal(whole, output)
    assert not list(tmp_path.glob("*checkpoint*"))


def test_histories_are_learned_from_all_of_several_sequences(rusting, tmp_path):
    """Of whatever sizes and numbers of frames; the first says how many ages there are."""
    weathering.write("rust", tmp_path / "second", size=16, frames=4, seed=1)
    config = replace(TINY, texels=301)
    folders = (rusting, tmp_path / "second")
    path = train(rusting, tmp_path / "moss.safetensors", sequences=folders, config=config)
    card = read_card(path)
    assert card.trained["texels"] == 300
    assert card.frames == 6
    assert f"{rusting} {tmp_path / 'second'} " in card.trained["command"]
    assert "--texels 301" in card.trained["command"]
    assert "only 4 frames" in " ".join(card.details["warnings"])


def test_a_mixture_is_learned_from_alone(rusting, tmp_path):
    mixture = tmp_path / "mixture"
    mixture.mkdir()
    (mixture / "mixture.json").write_text('{"materials": ["steel", "alum-bronze"]}')
    for k in (1, 2):
        write_exr(mixture / f"w_000{k}.exr", np.zeros((2, 2), np.float32))
    with pytest.raises(InputError, match="from alone"):
        train(rusting, tmp_path / "moss.safetensors", sequences=(rusting, mixture))


def test_a_damaged_checkpoint_is_a_sentence(rusting, tmp_path):
    (tmp_path / "moss.parameters.checkpoint.safetensors").write_bytes(bytes(100))
    with pytest.raises(ModelFileError, match="cannot be read"):
        train(rusting, tmp_path / "moss.safetensors", resume=True)


def test_what_is_affine_gets_the_affine_model(tmp_path):
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
    assert not list(tmp_path.rglob("above.*")), "nor logged"


def test_what_stays_gets_the_constant(tmp_path):
    rng = np.random.default_rng(0)
    kd, ks = rng.uniform(0.2, 0.6, (2, 12, 12, 3)).astype(np.float32)
    still = [np.repeat(m[None], 4, 0) for m in (kd, ks, np.full((12, 12), 0.2, np.float32))]
    write_sequence(tmp_path / "still", *still)
    path = train(tmp_path / "still", tmp_path / "moss.safetensors")
    assert read_card(path).details["temporal_model"] == "constant"


def test_a_folder_without_a_sequence(tmp_path):
    with pytest.raises(InputError, match="holds no sequence"):
        train(tmp_path, tmp_path / "moss.safetensors")


def test_a_checkpoint_that_is_no_number_replaces_no_model(rusting, tmp_path):
    output = train(rusting, tmp_path / "moss.safetensors")
    good = output.read_bytes()
    kill_at(7, lambda: train(rusting, output))
    checkpoint = tmp_path / "moss.latents.checkpoint.safetensors"
    spoil(checkpoint)
    with pytest.raises(ModelFileError, match="not finite"):
        train(rusting, output, resume=True)
    assert output.read_bytes() == good


def test_nor_does_a_training_whose_values_are_none(rusting, tmp_path, monkeypatch):
    output = train(rusting, tmp_path / "moss.safetensors")
    good = output.read_bytes()

    def fit(histories, observed):
        return Affine(*torch.full((2, histories.shape[1], 7), torch.inf))

    monkeypatch.setattr(ntm.Affine, "fit", fit)
    with pytest.raises(ModelFileError, match="not finite"):
        train(rusting, output)
    assert output.read_bytes() == good
    assert not list(tmp_path.glob(".*"))


def test_a_training_that_diverges_says_so(rusting, tmp_path):
    output = tmp_path / "moss.safetensors"
    with pytest.raises(DivergedError):
        train(rusting, output, config=replace(TINY, learning_rate=float("inf")))
    assert not list(tmp_path.glob("*.safetensors"))


@pytest.mark.parametrize("what", ["output", "checkpoint", "log", "parent"])
def test_what_cannot_be_written_is_known_before(rusting, tmp_path, monkeypatch, what):
    output = tmp_path / "new" / "moss.safetensors"
    if what == "parent":
        (tmp_path / "new").write_text("in the way")
    elif what == "log":
        (tmp_path / "new").mkdir()
        output.with_suffix(".tensorboard").write_text("in the way")
    else:
        ending = ".safetensors" if what == "output" else ".parameters.checkpoint.safetensors"
        output.with_suffix(ending).mkdir(parents=True)
    monkeypatch.setattr(tqdm, "__iter__", None)  # no step is taken
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
def test_a_card_that_nobody_could_read_is_refused_before(rusting, tmp_path, field, value):
    with pytest.raises(UsageError, match=f"its {field} ") as error:
        train(rusting, tmp_path / "moss.safetensors", card=CARD | {field: value})
    assert str(error.value).isprintable()
    assert not list(tmp_path.iterdir())


def test_everybody_who_may_by_the_umask_can_read_it(rusting, tmp_path):
    before = os.umask(0o027)
    try:
        path = train(rusting, tmp_path / "moss.safetensors")
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o640


def test_nothing_is_said_before_the_encoder_where_no_source_is_named(rusting, tmp_path):
    path = train(rusting, tmp_path / "moss.safetensors", card=CARD | {"source": ""})
    assert read_card(path).source.startswith("Encoder: ")


def test_a_folder_of_any_name_can_be_learned_from(rusting, tmp_path):
    folder = tmp_path / "se\x1bquence \udce9"
    folder.symlink_to(rusting)
    path = train(folder, tmp_path / "moss.safetensors")
    assert "quence" in read_card(path).trained["command"]


def test_a_missing_encoder(rusting, tmp_path):
    with pytest.raises(ModelFileError, match="no model file"):
        train(rusting, tmp_path / "moss.safetensors", encoder=tmp_path / "none.safetensors")
