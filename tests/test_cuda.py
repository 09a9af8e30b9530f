"""What needs a GPU: that it computes what the CPU does (`make gpu-check` runs these)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from model_runtime.device import CPU
from model_runtime.representation import build, load_representation
from tests.aging import frames_of, run, write_painted_steel
from tests.trainings import small
from tests.trainings_together import ended_halfway, train
from training import ntm
from training.data import weathering
from training.data.nbrdf import load
from training.distributed import Share, joined
from training.encoder import training_loss
from training.source.histories import source_histories

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs CUDA")

DEVICES = ("cpu", "cuda")


def test_maps_are_the_cpu_s(tmp_path: Path):
    source = write_painted_steel(tmp_path / "steel", 64)
    maps = {}
    for device in DEVICES:
        output = tmp_path / device
        options = {"temporal_model": "lstm_latents", "binding": "frames", "frames": 3}
        report = run(source, output, ntm="char", device=device, **options)
        assert report["device"] == device
        maps[device] = {name: frames_of(output, name, 3) for name in ("base_color", "roughness")}
    for name, pixels in maps["cpu"].items():
        off = pixels.astype(np.float64) - maps["cuda"][name]
        assert -10 * np.log10(np.square(off).mean() + 1e-12) > 50, name


@pytest.mark.parametrize("name", ["fast", "paper"])
def test_an_encoder_s_loss_and_gradient_are_the_cpu_s(data_folder, name: str):
    recipe = small(name)
    measured = load(data_folder, "merl")
    found: dict[str, tuple[float, Tensor]] = {}
    for device in DEVICES:
        torch.manual_seed(0)
        model = build(recipe.representation).eval()
        g = torch.Generator().manual_seed(1)
        with joined(device) as world:
            model.to(world.device)
            mine = Share(recipe.batch, device=world.device)
            loss = training_loss(model, recipe, measured, g, mine)
            loss.backward()
        grads = [w.grad.flatten().to(CPU) for w in model.parameters() if w.grad is not None]
        found[device] = loss.item(), torch.cat(grads)
    assert found["cuda"][0] == pytest.approx(found["cpu"][0], rel=1e-2)
    cosine = torch.cosine_similarity(found["cpu"][1], found["cuda"][1], 0)
    assert float(cosine) > 0.99


def test_a_temporal_model_learns_what_it_does_on_the_cpu(tmp_path: Path):
    representation, _ = load_representation()
    sequence = weathering.generate("rust", size=12, frames=6)
    source = source_histories(sequence, representation)
    config = ntm.NTMConfig(iterations=60, batch=64, warm_up=5)
    missed = {}
    for device in DEVICES:
        with joined(device) as world:
            run = ntm.Run(tmp_path / device, world=world)
            model, _ = ntm.train_lstm("parameters", source, representation, config, run)
        with torch.no_grad():
            rolled = model.rollout(source.parameters[:, 0], 6)
        missed[device] = float((rolled - source.parameters).abs().mean())
    assert missed["cuda"] == pytest.approx(missed["cpu"], rel=0.1)


def test_what_a_gpu_began_the_cpu_ends(data_folder, tmp_path: Path):
    weathering.write("rust", tmp_path / "sequence", size=12, frames=4)
    for what in ("fast", "ntm"):
        with joined("cuda") as world, ended_halfway():
            train(what, tmp_path, "handed_over", world=world)
        train(what, tmp_path, "handed_over", resume=True)
        assert (tmp_path / f"{what}_handed_over.safetensors").is_file()
