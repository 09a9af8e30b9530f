"""The methods that the report `representation` compares: how each holds a material."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor

from model_runtime.brdf import lobes
from model_runtime.brdf.fit import fit_angles
from model_runtime.brdf.lobes import LobedFit, one_more
from model_runtime.brdf.refinement import Measurements, fit_seen
from model_runtime.brdf.views import views
from model_runtime.channels import FURTHER, WIDTH
from model_runtime.model_files.weights import read_card
from model_runtime.representation.latents import PAPER_SAMPLES, Latents
from model_runtime.representation.measured import encode_measured
from model_runtime.representation.paper import PaperRepresentation

from ...baselines import nbrdf
from ...baselines.encoders import Encoder, load_encoder
from ..bench.encoders import trained_encoder
from ..bench.results import chosen
from .results import Cost
from .sets import FRAMES, Evaluate, Materials

__all__ = (
    "METHODS",
    "Budget",
    "EncoderMethod",
    "Held",
    "Method",
    "Setting",
    "load_methods",
)

_TEXEL_SAMPLES = 1_024
_CURVE = (16, 32, 64, 128, 256, 512, 1_024, 4_096, PAPER_SAMPLES)
_AT_ONCE = 1 << 16
_TIMED_DIRECTIONS = 2_048
_MEASURED_BY_NETWORKS = ("merl_seen", "merl_held_out", "rgl")
_ONE_LOBE = ("torrance_sparrow", *FRAMES)


@dataclass(frozen=True)
class Setting:
    """How much is offered to a method for a BRDF: directions, and the share of its iterations that
    a method which trains on them may spend.
    """

    samples: int
    effort: float = 1.0


@dataclass(frozen=True)
class Held:
    """n BRDFs as a method holds them: `evaluate` as `Materials.evaluate`; `seconds` of one core it
    took to get them all. refined: whether each was looked at again (`encode_measured`).
    """

    evaluate: Evaluate
    n: int
    seconds: float
    texel: bool
    refined: bool = False


class Method(Protocol):
    """One way to hold BRDFs."""

    def applies_to(self, name: str) -> bool:
        """Whether the set `name` says anything about this method."""
        ...

    def settings(self) -> tuple[Setting, ...]:
        """From little to the method's own: the curve of accuracy over time."""
        ...

    def hold(self, materials: Materials, setting: Setting | None = None) -> Held:
        """What the method makes of `materials`, by default with its own setting."""
        ...

    def point(self, held: Sequence[Held], setting: Setting) -> tuple[int, int | None, float]:
        """Directions read for a BRDF, iterations spent on it, ms of one core to encode it."""
        ...

    def cost(self, held: Sequence[Held]) -> Cost:
        """Sizes and times, once everything is `held`."""
        ...


def _seconds(call: Callable[[], object]) -> float:
    """Seconds of one core that `call` takes: the least of several, as others may be at work."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    call()
    times: list[float] = []
    while len(times) < 3 or (sum(times) < 0.3 and len(times) < 20):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    torch.set_num_threads(threads)
    return min(times)


@dataclass(frozen=True)
class EncoderMethod:
    """A trained encoder and decoder.

    trained: what its card says of its training
    samples, texel_samples: directions offered for a uniform material and for a texel
    together: BRDFs decoded at once, as the processor's caches like it
    refines: whether measured BRDFs are looked at again, as the product does; not in the curve,
        which is the encoder's
    """

    model: Encoder
    trained: Mapping[str, Any]
    together: int = 64
    samples: int = PAPER_SAMPLES
    texel_samples: int = PAPER_SAMPLES
    refines: bool = False

    def applies_to(self, name: str) -> bool:
        """Every set does."""
        return True

    def settings(self) -> tuple[Setting, ...]:
        """Powers of two, then the paper's number; each number of directions really read once."""
        offered = {len(self.model.sample_angles(m)): Setting(m) for m in _CURVE}
        return tuple(offered[count] for count in sorted(offered))

    def hold(self, materials: Materials, setting: Setting | None = None) -> Held:
        """Encode all rows, a few at a time; decode those that are asked for."""
        own = self.samples if materials.texels is None else self.texel_samples
        m = own if setting is None else setting.samples
        refined = self.refines and materials.measured and setting is None
        start = time.process_time()
        if refined:
            latents = encode_measured(self.model, materials.every).latents
        else:
            angles = self.model.sample_angles(m, measured=materials.measured)
            f = materials.every(angles)
            start = time.process_time()
            few = f.split(max(1, _AT_ONCE // len(angles)))
            parts = [self.model.encode(angles, some) for some in few]
            color = torch.cat([part.color for part in parts])
            latents = Latents(color, torch.cat([part.shared for part in parts]))
        seconds = time.process_time() - start

        def decode(rows: Tensor, wanted: Tensor) -> Tensor:
            few = rows.split(self.together)
            some = (Latents(latents.color[r], latents.shared[r]) for r in few)
            return torch.cat([self.model.decode(each, wanted) for each in some])

        return Held(decode, materials.n, seconds, materials.texels is not None, refined)

    def point(self, held: Sequence[Held], setting: Setting) -> tuple[int, int | None, float]:
        """Timed anew, in batches of up to 64 BRDFs."""
        angles = self.model.sample_angles(setting.samples)
        f = torch.rand(max(1, min(64, _AT_ONCE // len(angles))), len(angles), 3)
        seconds = _seconds(lambda: self.model.encode(angles, f)) / len(f)
        return len(angles), None, round(1e3 * seconds, 4)

    def cost(self, held: Sequence[Held]) -> Cost:
        """Decoding is measured with as many BRDFs at once as in the report."""
        angles = self.model.sample_angles(_TIMED_DIRECTIONS)
        latents = self.model.encode(angles, torch.rand(self.together, len(angles), 3))
        wanted = PaperRepresentation().sample_angles(_TIMED_DIRECTIONS)
        decode = _seconds(lambda: self.model.decode(latents, wanted))
        samples, _, encode_ms = self.point(held, Setting(self.samples))
        again = [one for one in held if one.refined]
        spent, n = sum(one.seconds for one in again), sum(one.n for one in again)
        return Cost(
            parameters=sum(p.numel() for p in self.model.parameters()),
            latent_dims=sum(self.model.latent_sizes),
            encode_ms=encode_ms,
            decode_us_per_sample=round(1e6 * decode / len(wanted) / self.together, 4),
            train_minutes=self.trained.get("minutes"),
            train_iterations=self.trained.get("iterations"),
            samples=samples,
            texel_samples=len(self.model.sample_angles(self.texel_samples)),
            refine_ms=round(1e3 * spent / n, 1) if n else None,
        )


@dataclass(frozen=True)
class Budget:
    """Iterations that NBRDF spends on a uniform material and on a texel."""

    uniform: int = 30_000
    texel: int = 4_000


@dataclass(frozen=True)
class NetworkMethod:
    """NBRDF: a network a material, trained on the directions that the paper's encoder reads and
    kept in `folder`. The truth of MERL and RGL *is* such networks, so these sets say nothing of it.
    """

    folder: Path
    budget: Budget

    def applies_to(self, name: str) -> bool:
        """All but the sets whose truth is networks of this kind."""
        return name not in _MEASURED_BY_NETWORKS

    def settings(self) -> tuple[Setting, ...]:
        """Few directions, then few iterations: its time depends on the latter alone."""
        few, efforts = (Setting(16), Setting(256)), (0.01, 0.1, 1.0)
        return (*few, *(Setting(PAPER_SAMPLES, effort) for effort in efforts))

    def hold(self, materials: Materials, setting: Setting | None = None) -> Held:
        """Train a network a row, or find those of an earlier run."""
        setting = setting or Setting(PAPER_SAMPLES)
        texel = materials.texels is not None
        own = self.budget.texel if texel else self.budget.uniform
        training = nbrdf.Training(max(1, round(own * setting.effort)))
        angles = PaperRepresentation().sample_angles(setting.samples)
        name = f"networks_{materials.key}_{len(angles)}_{training.iterations}.safetensors"
        networks = nbrdf.cached_fit(self.folder / name, angles, materials.every(angles), training)
        return Held(networks.evaluate, len(networks), networks.seconds, texel)

    def point(self, held: Sequence[Held], setting: Setting) -> tuple[int, int | None, float]:
        """Training *is* the encoding."""
        spent, n = (sum(getattr(one, name) for one in held) for name in ("seconds", "n"))
        iterations = round(self.budget.uniform * setting.effort)
        return setting.samples, iterations, round(1e3 * spent / n, 4)

    def cost(self, held: Sequence[Held]) -> Cost:
        """`encode_ms` is the training of a uniform material; `train_minutes` that of everything."""
        angles = PaperRepresentation().sample_angles(_TIMED_DIRECTIONS)
        some, rows = held[0], torch.arange(held[0].n)
        decode = _seconds(lambda: some.evaluate(rows, angles))
        uniform = [one for one in held if not one.texel] or held
        samples, iterations, encode_ms = self.point(uniform, Setting(PAPER_SAMPLES))
        return Cost(
            parameters=nbrdf.PARAMETERS,
            latent_dims=nbrdf.PARAMETERS,
            encode_ms=encode_ms,
            decode_us_per_sample=round(1e6 * decode / len(angles) / some.n, 4),
            train_minutes=round(sum(one.seconds for one in held) / 60, 2),
            train_iterations=iterations,
            samples=samples,
            texel_samples=samples,
        )


@dataclass(frozen=True)
class LobesMethod:
    """A diffuse term and as many `lobes`, fitted by what is seen as `age` does it, whatever they
    gain: what maps and curves hold of a measured material. Torrance-Sparrow's own sets say nothing
    of it.
    """

    lobes: int

    def applies_to(self, name: str) -> bool:
        """All but the sets whose truth is one lobe."""
        return name not in _ONE_LOBE

    def settings(self) -> tuple[Setting, ...]:
        """None: it always reads the same directions."""
        return ()

    def hold(self, materials: Materials, setting: Setting | None = None) -> Held:
        """Fit all rows, with one lobe and then with more."""
        start = time.process_time()
        fit = LobedFit.of(fit_seen(materials.every))
        if self.lobes > 1:
            measured = Measurements.of(materials.every)
            for _ in range(1, self.lobes):
                fit = one_more(measured, fit)
        seconds = time.process_time() - start
        return Held(
            lambda rows, angles: lobes.evaluate(fit.lobed[rows], angles),
            materials.n,
            seconds,
            texel=False,
        )

    def point(self, held: Sequence[Held], setting: Setting) -> tuple[int, int | None, float]:
        """As it was held."""
        spent, n = (sum(getattr(one, name) for one in held) for name in ("seconds", "n"))
        return setting.samples, None, round(1e3 * spent / n, 4)

    def cost(self, held: Sequence[Held]) -> Cost:
        """`encode_ms` is the fit."""
        angles = PaperRepresentation().sample_angles(_TIMED_DIRECTIONS)
        some, rows = held[0], torch.arange(held[0].n)
        decode = _seconds(lambda: some.evaluate(rows, angles))
        read = len(fit_angles()) + len(views().angles)
        samples, _, encode_ms = self.point(held, Setting(read))
        numbers = WIDTH + (self.lobes - 1) * FURTHER
        return Cost(
            parameters=numbers,
            latent_dims=numbers,
            encode_ms=encode_ms,
            decode_us_per_sample=round(1e6 * decode / len(angles) / some.n, 4),
            train_minutes=None,
            train_iterations=None,
            samples=samples,
            texel_samples=samples,
        )


_SLOW = {"together": 2, "texel_samples": _TEXEL_SAMPLES}

METHODS: Mapping[str, Mapping[str, Any]] = {
    "ours": {"refines": True},
    "paper": _SLOW,
    "paper_long": _SLOW,
    "brdfnps": _SLOW,
    "deepbrdf": {},
    "hyperbrdf": {"together": 8, "texel_samples": _TEXEL_SAMPLES},
    "nbrdf": {},
    "one_lobe": {"lobes": 1},
    "two_lobes": {"lobes": 2},
    "three_lobes": {"lobes": 3},
}
"""By name, how it is used."""

_OPTIONAL = ("one_lobe", "two_lobes", "three_lobes", "paper_long")
"""Not compared unless they are asked for; the last one is where its weights are there."""


def load_methods(
    names: Sequence[str] | None, *, weights: Path, cache: Path, budget: Budget
) -> dict[str, Method]:
    """The methods `names` (by default all but the optional ones).

    Raises `UsageError` for an unknown name, `ModelFileError` for weights that are missing.
    """
    wanted = chosen("method", names, METHODS)
    if names is None:
        long_is_there = (weights / "paper_long.safetensors").exists()
        left_out = _OPTIONAL[: len(_OPTIONAL) - long_is_there]
        wanted = tuple(name for name in wanted if name not in left_out)
    methods: dict[str, Method] = {}
    for name, use in METHODS.items():
        if name not in wanted:
            continue
        if name == "nbrdf":
            methods[name] = NetworkMethod(cache, budget)
            continue
        if "lobes" in use:
            methods[name] = LobesMethod(**use)
            continue
        path = trained_encoder(name, weights)
        model = EncoderMethod(load_encoder(path), read_card(path).trained)
        methods[name] = replace(model, **use)
    return methods
