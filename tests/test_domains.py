"""ROC curves of domains: the curve itself by hand, and that every process knows its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import list_models, save_model
from model_runtime.temporal.domain import Domain
from model_runtime.temporal.models import LatentLSTM, ParameterLSTM
from training.data.kinetics import PROCESSES
from training.data.weathering import generate
from training.evaluation.synthesis.charts import chart_domains
from training.evaluation.synthesis.domains import (
    FITTING,
    FOREIGN,
    DomainResult,
    domain_roc,
    judged,
    roc,
)

pytestmark = pytest.mark.usefixtures("one_thread")


def domain(process: str) -> Domain:
    """As training makes it, of the tile with seed 0."""
    first = generate(process, size=96, frames=2, seed=0)
    maps = np.concatenate((first.kd[0], first.ks[0], first.alpha[0][..., None]), -1)
    return Domain.of(torch.from_numpy(maps.reshape(-1, 7)))


def write_ntm(path: Path, process: str, known: Domain) -> None:
    tensors = {
        "affine.gain": torch.ones(2, 7),
        "affine.offset": torch.zeros(2, 7),
        "domain.centres": known.centers,
        "domain.radii": known.radii,
        **{f"parameters.{k}": v for k, v in ParameterLSTM().state_dict().items()},
        **{f"latents.{k}": v for k, v in LatentLSTM(12, 8).state_dict().items()},
    }
    card = {"name": path.stem, "title": path.stem, "process": process, "frames": 2}
    save_model(path, tensors, {**card, "temporal_model": "affine"}, kind="ntm")


class TestROC:
    def area(self, near: list[list[float]], far: list[list[float]]) -> float:
        false_alarms, caught = roc([torch.tensor(d) for d in near], [torch.tensor(d) for d in far])
        assert (false_alarms[0], caught[0], false_alarms[-1], caught[-1]) == (0, 0, 1, 1)
        return DomainResult(false_alarms, caught, {}, ()).auroc

    def test_the_area_is_the_share_of_pairs_in_order(self):
        assert self.area([[0.1, 0.2]], [[0.3], [0.4]]) == pytest.approx(1)
        assert self.area([[0.3, 0.4]], [[0.1, 0.2]]) == pytest.approx(0)
        assert self.area([[0.5, 0.5]], [[0.5]]) == pytest.approx(0.5)
        near, far = np.random.default_rng(0).random((2, 40)).astype(np.float32)
        far += 0.2
        pairs = (far[:, None] > near).mean()
        assert self.area([near.tolist()], [far.tolist()]) == pytest.approx(pairs)

    def test_a_material_weighs_the_same_however_many_texels_it_has(self):
        assert self.area([[0.5]], [[0.1], [0.9] * 99]) == pytest.approx(0.5)


class TestMaterials:
    def test_each_process_has_ten_named_beforehand(self):
        assert set(FITTING) == set(FOREIGN) == set(PROCESSES)
        for process, names in FOREIGN.items():
            assert len(set(names)) == 10
            assert FITTING[process] not in names

    @pytest.mark.parametrize("process", sorted(PROCESSES))
    def test_each_process_knows_its_own(self, data_folder: Path, process: str):
        """AUROC 0.95 is asked for. Other tiles are in, foreign materials out."""
        found = judged(domain(process), process, data_folder).json()
        assert found["auroc"] > 0.98
        assert found["wrong"] == []
        assert all(share < 0.05 for name, share in found["outside"].items() if "seed" in name)


class TestReport:
    def test_models_are_judged_by_their_process(self, data_folder: Path, tmp_path: Path):
        write_ntm(tmp_path / "mine.safetensors", "moss", domain("moss"))
        write_ntm(tmp_path / "other.safetensors", "snow", domain("moss"))
        results = domain_roc(list_models((tmp_path,)), data_folder)
        assert set(results) == {"mine"}
        found = json.loads(json.dumps(results["mine"].json()))
        assert set(found) == {"auroc", "accepted", "refused", "wrong", "outside"}
        assert found["refused"] == list(FOREIGN["moss"])
        assert FITTING["moss"] in found["accepted"]
        assert chart_domains(results, tmp_path / "domains.png")
        assert (tmp_path / "domains.png").stat().st_size > 5000

    def test_a_model_that_knows_everything_is_found_out(self, data_folder: Path):
        everything = Domain(torch.full((1, 7), 0.5), torch.tensor([9.0]))
        found = judged(everything, "rust", data_folder).json()
        assert found["refused"] == []
        assert found["wrong"] == list(FOREIGN["rust"])
        assert found["auroc"] < 0.95

    def test_without_models_there_is_no_chart(self, data_folder: Path, tmp_path: Path):
        assert domain_roc([], data_folder) == {}
        assert not chart_domains({}, tmp_path / "domains.png")
        assert not (tmp_path / "domains.png").exists()

    def test_a_damaged_model_is_a_sentence(self, data_folder: Path, tmp_path: Path):
        known = domain("moss")
        write_ntm(tmp_path / "a.safetensors", "moss", Domain(known.centers, known.radii[:5]))
        with pytest.raises(ModelFileError, match=r"a\.safetensors"):
            domain_roc(list_models((tmp_path,)), data_folder)
