"""Training in two processes: what one would have learned, whoever began and whoever goes on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import load_file

from model_runtime.errors import UsageError
from tests.trainings_together import WHAT, ended_halfway, train
from training.data import weathering
from training.data.materials import damage, draw_batch, loss_angles
from training.data.nbrdf import load
from training.distributed import Share, World

pytestmark = pytest.mark.usefixtures("one_thread")

ROOT = Path(__file__).resolve().parents[1]
TORCHRUN = ("-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2")
NOISE = 1e-4  # of a weight's largest number: the order of sums


@pytest.fixture(scope="module")
def together(data_folder, tmp_path_factory) -> Path:
    """A folder in which two processes trained (see tests/trainings_together.py), after one had
    begun there, and then one alone.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("together")
    weathering.write("rust", folder / "sequence", size=12, frames=4)
    for what in WHAT:
        with ended_halfway():
            train(what, folder, "one_first")
    done = subprocess.run(
        [sys.executable, *TORCHRUN, "-m", "tests.trainings_together", str(folder)],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1", "TVBRDF_DATA": str(data_folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for what in WHAT:
        train(what, folder, "alone")
        train(what, folder, "many_first", resume=True)
    torch.set_num_threads(threads)
    return folder


def farthest(one: Path, other: Path) -> float:
    """The largest difference between two weights of a name, by that weight's largest number."""
    a, b = load_file(one), load_file(other)
    assert a.keys() == b.keys()
    return max(
        float((a[name] - b[name]).abs().max() / a[name].abs().max().clamp_min(1e-3)) for name in a
    )


@pytest.mark.parametrize("name", ["whole", "one_first", "many_first"])
@pytest.mark.parametrize("what", WHAT)
def test_any_number_of_processes_learns_what_one_does(together: Path, what: str, name: str):
    alone, other = (together / f"{what}_{each}.safetensors" for each in ("alone", name))
    assert farthest(alone, other) < NOISE


def test_minutes_end_all_processes_at_one_step(together: Path):
    """Else one would wait for the other, and nothing would have been written."""
    assert (together / "ntm_minutes.safetensors").is_file()
    assert not list(together.glob("*.checkpoint.*"))


@settings(deadline=None)
@given(st.integers(1, 40), st.integers(1, 9), st.data())
def test_shares_are_a_batch_once(whole: int, size: int, data: st.DataObject):
    start = data.draw(st.integers(0, whole))
    count = data.draw(st.integers(0, whole - start))
    batch = torch.arange(whole)
    shares = [Share(whole, rank, size) for rank in range(size)]
    assert torch.cat([mine(batch) for mine in shares]).sort().values.equal(batch)
    assert sum(mine.weight for mine in shares) == pytest.approx(size)
    for mine in shares:
        assert len(mine(batch)) == len(mine)
        among = mine.among(start, count)(batch[start : start + count])
        wanted = mine(batch)
        assert among.equal(wanted[(wanted >= start) & (wanted < start + count)])


@pytest.mark.parametrize("size", [2, 5, 24])
def test_materials_are_those_of_the_whole_batch(data_folder, size: int):
    """Measured, Disney's and Torrance-Sparrow's, damaged: each process has its rows of them."""
    measured, angles = load(data_folder, "merl"), loss_angles(40, generator())

    def seen(mine: Share) -> torch.Tensor:
        g = generator()
        sources = draw_batch(measured, mine, g, bent=0.7, torrance_sparrow=0.25)
        f = torch.cat([evaluate(angles) for evaluate in sources])
        return damage(angles, f, 0.5, g, mine, measured=12)

    whole = seen(Share(24))
    for rank in range(size):
        mine = Share(24, rank, size)
        torch.testing.assert_close(seen(mine), mine(whole), equal_nan=True)


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(5)


def test_more_processes_than_a_batch_has_rows_is_a_sentence():
    with pytest.raises(UsageError, match="A batch of 3 cannot be divided among 4") as error:
        World(rank=1, size=4).share(3)
    assert "--batch" in error.value.hint


def test_so_is_a_checkpoint_that_not_all_see(together: Path, monkeypatch):
    monkeypatch.setattr(World, "agreed", lambda world, value: value + 1)
    with pytest.raises(UsageError, match="Not all processes see the checkpoint"):
        train("fast", together, "lost")
