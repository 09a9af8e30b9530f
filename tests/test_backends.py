"""PyTorch, and what stands for it over numpy: the same numbers, of the same kinds, and the same
maps.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

from model_runtime.backend import on_numpy
from model_runtime.contract import BACKEND, NUMPY, TORCH
from model_runtime.images import read_image
from model_runtime.live.files import read_live
from model_runtime.model_files.weights import list_models
from tests.aging import write_painted_steel
from tests.live_states import start_of

ROOT = Path(__file__).resolve().parents[1]
DB = 60.0

SINGLE = np.random.default_rng(0).uniform(0.05, 3, (5, 4, 3)).astype(np.float32)
SIGNED = SINGLE - 1
KINDS: dict[str, Any] = {
    "singles": SIGNED,
    "doubles": SINGLE.astype(np.float64),
    "halves": SINGLE.astype(np.float16),
    "integers": (SINGLE * 5).astype(np.int64),
    "bytes": (SINGLE * 50).astype(np.uint8),
    "booleans": SINGLE > 1,
    "a single": np.float32(0.7),
    "a double": np.float64(0.7),
    "an integer": np.int64(3),
}
NUMBERS: dict[str, Any] = {"true": True, "two": 2, "a half": 0.5}

Compute = Callable[[ModuleType, Any, Any], Any]

ARITHMETIC: dict[str, Compute] = {
    "sum": lambda t, x, y: x + y,
    "product": lambda t, x, y: x * y,
    "difference": lambda t, x, y: x - y,
    "ratio": lambda t, x, y: x / y,
    "order": lambda t, x, y: (x < y) | (x >= y) & (x != y),
    "choice": lambda t, x, y: t.where(x > 1, x, y),
}


def same(compute: Callable[[ModuleType, Callable[[Any], Any]], Any], *, apart: float) -> None:
    """What both make of it is of one kind and shape, and as near as rounding allows."""
    with torch.inference_mode(), on_numpy.inference_mode():
        try:
            theirs = compute(torch, lambda x: torch.from_numpy(np.array(x)))
        except RuntimeError:
            return  # PyTorch refuses it
        ours = compute(on_numpy, lambda x: on_numpy.from_numpy(np.array(x)))
    for one, other in zip(_listed(theirs), _listed(ours), strict=True):
        expected = one.numpy()
        assert isinstance(other, on_numpy.Tensor)
        assert other.numpy().dtype == expected.dtype
        np.testing.assert_allclose(other.numpy(), expected, rtol=apart, atol=apart)


def _listed(found: Any) -> list[Any]:
    return list(found) if isinstance(found, tuple) else [found]


@pytest.mark.parametrize("what", ARITHMETIC)
@pytest.mark.parametrize("right", [*KINDS, *NUMBERS])
@pytest.mark.parametrize("left", KINDS)
def test_of_two_kinds_of_numbers_comes_the_same_kind(left: str, right: str, what: str):
    def compute(t: ModuleType, tensor: Callable[[Any], Any]) -> Any:
        second = NUMBERS[right] if right in NUMBERS else tensor(KINDS[right])
        return ARITHMETIC[what](t, tensor(KINDS[left]), second)

    same(compute, apart=2e-3 if "halves" in (left, right) else 1e-6)


ROWS = np.random.default_rng(1).uniform(-2, 2, (40, 6)).astype(np.float32)
OTHERS = np.random.default_rng(2).uniform(-2, 2, (30, 6)).astype(np.float32)
BATCH = np.random.default_rng(3).uniform(-1, 1, (5, 4, 4)).astype(np.float32)

Applied = Callable[[ModuleType, Any, Any, Any], Any]
OPERATIONS: dict[str, Applied] = {
    **{
        name: lambda t, x, y, b, name=name: getattr(x, name)()
        for name in (
            *("abs", "cos", "exp", "expm1", "floor", "isfinite", "round", "sin", "square", "tanh"),
            *("all", "any", "amax", "amin", "argmax", "argmin", "max", "mean", "min", "sum"),
            *("fliplr", "flatten", "contiguous", "clone", "nonzero", "unique", "argsort"),
        )
    },
    **{
        name: lambda t, x, y, b, name=name: getattr(x.abs(), name)()
        for name in ("log", "log10", "log1p", "sqrt")
    },
    "powers": lambda t, x, y, b: (x**2, x**3, x**4, x**5, x.abs() ** 2.5, x.abs().pow(0.3), 2.0**x),
    "whole powers": lambda t, x, y, b: x.long() ** 2,
    "atan2": lambda t, x, y, b: t.atan2(x, x.flip(0)) if t is torch else t.atan2(x, x[::-1]),
    "hypot": lambda t, x, y, b: t.hypot(x, x * 2),
    "sigmoid": lambda t, x, y, b: t.sigmoid(x),
    "silu": lambda t, x, y, b: t.nn.functional.silu(x * 20),
    "normalize": lambda t, x, y, b: t.nn.functional.normalize(x, dim=-1),
    "pad": lambda t, x, y, b: t.nn.functional.pad(x, (1, 0, 2, 3), value=7.0),
    "lerp": lambda t, x, y, b: (t.lerp(x, x * 3, x), t.lerp(x, x + 1, 0.25)),
    "lerp of halves": lambda t, x, y, b: t.lerp(x.half(), (x * 3).half(), x[0].half().abs()),
    "clamp": lambda t, x, y, b: (x.clamp(-1, 1), x.clamp(max=0), x.clamp_min(0), x.clamp_max(0)),
    "clamp by tensors": lambda t, x, y, b: (x.clamp(-x.abs() / 2, x.abs()), x.clamp_min(x[0])),
    "masked_fill": lambda t, x, y, b: x.masked_fill(x > 0, 9),
    "remainder": lambda t, x, y, b: (t.remainder(x, 0.7), x.long() % 3),
    "whole": lambda t, x, y, b: (x.long(), x.int(), x.double(), (x > 0).float()),
    "minimum": lambda t, x, y, b: t.minimum(x, -x),
    "addcmul": lambda t, x, y, b: t.addcmul(x, x, x),
    "shapes": lambda t, x, y, b: (x.T, b.mT, b.movedim(0, 2), b.transpose(1, 2), x.reshape(-1, 3)),
    "unflatten": lambda t, x, y, b: (x.unflatten(0, (4, 10)), b.flatten(1), b.flatten(0, 1)),
    "expand": lambda t, x, y, b: (x[:, None].expand(-1, 2, -1), x[0].expand_as(x), x.repeat(2, 3)),
    "parts": lambda t, x, y, b: (*x.split(15), *x.split((2, 4), 1), *x.unbind(1), *x),
    "together": lambda t, x, y, b: (t.cat((x, y)), t.cat((x, x), 1), t.stack((x, x), 1)),
    "grids": lambda t, x, y, b: (
        t.cartesian_prod(x[0], y[0]),
        *t.meshgrid(x[0], y[:, 0], indexing="ij"),
    ),
    "indexed": lambda t, x, y, b: (x[x[:, 0] > 0], x[t.arange(3)], x[..., 1:3], x[None], x[2, 3]),
    "sums": lambda t, x, y, b: (x.sum(1), b.sum((0, 2)), b.mean(1, keepdim=True), (x > 0).sum(0)),
    "least": lambda t, x, y, b: (*x.min(1), *x.aminmax(), *x.aminmax(dim=1), x.argmin(1)),
    "median": lambda t, x, y, b: x.median(1, keepdim=True).values,
    "nearest": lambda t, x, y, b: (*x.topk(3, largest=False), *x.topk(6, largest=False)),
    "running": lambda t, x, y, b: (x.cumsum(1), x[:, 0].cummax(0).values),
    "norm": lambda t, x, y, b: (x.norm(), x.norm(dim=-1)),
    "counts": lambda t, x, y, b: t.bincount(x.abs().long().flatten(), minlength=9),
    "searchsorted": lambda t, x, y, b: (
        t.searchsorted(t.arange(3), x.long().contiguous()),
        t.searchsorted(t.linspace(-1, 1, 5), x, right=True),
    ),
    "products": lambda t, x, y, b: (x @ y.T, b @ b, b @ x[:4], t.bmm(b, b), t.bmm(b[:, :1], b)),
    "tensordot": lambda t, x, y, b: t.tensordot(x, y.T, 1),
    "einsum": lambda t, x, y, b: (
        t.einsum("nmc,km->nkc", b, x[:, :4]),
        t.einsum("nmc,nm->nc", b, b[:, 0]),
        t.einsum("nm,nmc,nc->n", b[:, 0], b, b[:, 1]),
        t.einsum("ta,pac->ptc", x[:, :4], b),
        t.einsum("vld,nvdc->nvlc", b, b[:, None].transpose(0, 1).expand(3, -1, -1, -1)),
    ),
    "distances": lambda t, x, y, b: (
        t.cdist(x, y),
        t.cdist(x[:9], y),
        t.cdist(x, y, compute_mode="donot_use_mm_for_euclid_dist"),
    ),
    "solve": lambda t, x, y, b: t.linalg.solve(b + 3 * t.eye(4), b),
    "eigh": lambda t, x, y, b: t.linalg.eigh(x.T @ x)[0],
    "made": lambda t, x, y, b: (
        *(t.zeros(2, 3), t.zeros((2, 3), dtype=t.half), t.ones(()), t.full((2,), 3.0), t.eye(3)),
        *(t.arange(4), t.arange(4.0), t.linspace(0, 1, 7), t.tensor((1.0, 2.0)), t.tensor(3)),
        *(
            t.zeros_like(x),
            t.ones_like(x),
            t.full_like(x, 2),
            x.new_full((2,), 1),
            x.new_tensor((1,)),
        ),
    ),
    "changed": lambda t, x, y, b: (_changed(t, x.clone()), _added(t, y.clone())),
    "chance": lambda t, x, y, b: (
        t.randint(1000, (50,), generator=t.Generator().manual_seed(3)),
        t.randperm(1000, generator=t.Generator().manual_seed(0)),
    ),
}


def _changed(t: ModuleType, x: Any) -> Any:
    x += 1
    x *= x
    x[:, 0] = 5
    x[x > 3] = 0
    x[1].copy_(x[0])
    return x.clamp_(0, 2)


def _added(t: ModuleType, y: Any) -> Any:
    rows = t.arange(30) % 7
    y.index_add_(0, rows, y.clone())
    y.index_copy_(0, t.arange(3), y[3:6].clone())
    return y


@pytest.mark.parametrize("name", OPERATIONS)
def test_each_operation_gives_the_same_numbers(name: str):
    def compute(t: ModuleType, tensor: Callable[[Any], Any]) -> Any:
        return OPERATIONS[name](t, *map(tensor, (ROWS, OTHERS, BATCH)))

    same(compute, apart=2e-3 if name == "lerp of halves" else 1e-5)


def test_products_are_the_same_without_a_library_for_them():
    products = on_numpy.products
    assert products.has_library()
    for a, b in ((ROWS, OTHERS.T), (BATCH[0], BATCH[1]), (BATCH, BATCH)):
        np.testing.assert_allclose(products.by_sums(a, b), a @ b, atol=1e-5)


class TestNetworks:
    @pytest.mark.parametrize("given", [False, True], ids=["first", "later"])
    def test_a_cell_remembers_alike(self, given: bool):
        theirs = torch.nn.LSTMCell(6, 4).requires_grad_(False)
        ours = on_numpy.nn.LSTMCell(6, 4)
        ours.load_state_dict(
            {k: on_numpy.Tensor(v.numpy()) for k, v in theirs.state_dict().items()}
        )
        memory = (ROWS[:, :4], ROWS[:, 1:5]) if given else None
        expected = theirs(torch.from_numpy(ROWS), memory and tuple(map(torch.tensor, memory)))
        found = ours(on_numpy.Tensor(ROWS), memory and tuple(map(on_numpy.Tensor, memory)))
        for one, other in zip(expected, found, strict=True):
            np.testing.assert_allclose(other.numpy(), one.numpy(), atol=1e-6)

    def test_what_does_not_fit_is_refused(self):
        layer = on_numpy.nn.Sequential(on_numpy.nn.Linear(2, 3), on_numpy.nn.SiLU())
        stored = layer.state_dict()
        assert list(stored) == ["0.weight", "0.bias"]
        with pytest.raises(RuntimeError):
            layer.load_state_dict({"0.weight": stored["0.weight"]})
        with pytest.raises(RuntimeError):
            layer.load_state_dict({**stored, "0.bias": on_numpy.zeros(4)})


_AGE = """
import json, sys
if sys.argv[1] == "none":
    sys.modules["torch"] = None
from pathlib import Path
from model_runtime.age import AgeRequest, age

class Silent:
    def progress(self, stage, fraction): pass
    def warning(self, message): pass
    def cancelled(self): return False

for job in json.load(sys.stdin):
    job |= {"input": Path(job["input"]), "output": Path(job["output"])}
    found = age(AgeRequest(**job), Silent())
    assert found["backend"] == ("torch" if sys.argv[1] == "torch" else "numpy"), found["backend"]
"""


def age_all(how: str, jobs: list[dict[str, Any]]) -> None:
    """In a process of its own, with a backend or, of "none", with no torch to import."""
    environment = {k: v for k, v in os.environ.items() if k != BACKEND}
    if how != "none":
        environment[BACKEND] = how
    command = [sys.executable, "-c", _AGE, how]
    done = subprocess.run(
        command, input=json.dumps(jobs), env=environment, capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10 * np.log10(max(float(np.square(one - other).mean()), 1e-12)))


@pytest.mark.slow
def test_every_bundled_model_makes_the_same_maps_with_and_without_torch(tmp_path: Path):
    source = write_painted_steel(tmp_path / "paint", 32)
    names = [card.name for card in list_models()]
    common = {"input": str(source), "frames": 4}
    jobs = [
        {**common, "ntm": name, "quality": quality, "binding": "live"}
        for name in names
        for quality in ("draft", "balanced")
    ]
    jobs += [
        # As reflectances: sockets of which little is seen tell rounding apart from it.
        {**common, "ntm": name, "temporal_model": rung, "size": 16, "format": "torrance-sparrow"}
        for name, rung in (
            ("rust", "lstm_latents"),
            ("moss", "lstm_parameters"),
            ("char", "affine"),
        )
    ]
    for how in (TORCH, "none"):
        age_all(
            how, [{**job, "output": str(tmp_path / f"{how} {k}")} for k, job in enumerate(jobs)]
        )
    start = start_of(source)
    for k, job in enumerate(jobs):
        one, other = (tmp_path / f"{how} {k}" for how in (TORCH, "none"))
        files = {path.name for path in one.iterdir()}
        assert files == {path.name for path in other.iterdir()}, job
        if "binding" in job and "curves.exr" in files:
            shown, ours = read_live(one), read_live(other)
            for time in (0.1, 0.5, 1.0):
                assert psnr(shown.at(start, time), ours.at(start, time)) >= DB, job
            continue
        for name in files:
            if name.endswith(".exr"):
                pixels = (read_image(folder / name, color=True) for folder in (one, other))
                assert psnr(*pixels) >= DB, (job, name)


def test_a_measurement_of_several_lobes_is_shown_as_well_without_torch(
    tmp_path: Path, data_folder: Path
):
    """Not by the same numbers: from the same starts rounding leads to other fits, as good."""
    felt = data_folder / "bsdf" / "acrylic_felt_green_rgb.bsdf"
    job = {"input": str(felt), "frames": 2, "ntm": "rust", "tolerance": 34.0, "onset": "none"}
    told = {}
    for how in (TORCH, "none"):
        age_all(how, [{**job, "output": str(tmp_path / how)}])
        told[how] = json.loads((tmp_path / how / "aged.json").read_text(encoding="utf-8"))
    assert told[TORCH]["lobes"] == told["none"]["lobes"] == 2
    one, other = (each["measured_db"]["fit"] for each in told.values())
    assert one == pytest.approx(other, abs=1)


def test_a_backend_that_is_none_is_refused():
    command = [sys.executable, "-m", "model_runtime", "age", "--input", "x", "--ntm", "rust"]
    done = subprocess.run(
        [*command, "--output", "x"],
        env={**os.environ, BACKEND: "abacus"},
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 1
    assert f"{BACKEND} is abacus" in done.stderr


def test_without_torch_nothing_is_learned(tmp_path: Path):
    command = [sys.executable, "-m", "training", "learn", str(tmp_path), "--name", "x"]
    done = subprocess.run(
        [*command, "--output", str(tmp_path / "x.safetensors")],
        env={**os.environ, BACKEND: NUMPY},
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 1
    assert "needs PyTorch" in done.stderr
    assert "Traceback" not in done.stderr
