"""Latents of a film over a ground, from those of the ground and the film: a network.

J. Fan, B. Wang, M. Hasan, J. Yang, L.-Q. Yan: Neural Layered BRDFs. SIGGRAPH 2022 Conference
Proceedings, written from the paper's idea at a size that a core trains in minutes: where theirs
takes the latents of two layers and the medium between, the upper layer here is a clear rough
boundary, told by its alpha, over a medium that absorbs, told by its optical depth. Latents are
those of our encoder, whose decoder shows what the network has made of them; truth is what random
walks through the stack find (`data.walks`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional
from tqdm import tqdm

from model_runtime.atomic import check_writable
from model_runtime.brdf.views import psnr_of, views
from model_runtime.errors import ModelFileError, shown
from model_runtime.representation import Trained, load_representation
from model_runtime.representation.latents import Latents
from model_runtime.representation.lobes import FLOOR, mlp

from ..data.walks import Film, Ground, evaluate_stack
from ..loop import Run, Schedule, Training, remove_checkpoints, train
from .weights import read_weights, write_weights

__all__ = ("Layering", "load_layering", "random_stacks", "train_layering")

_STACKS, _ITERATIONS = 8192, 6000
_BATCH = 128
_SCHEDULE = Schedule(2e-3, warm_up=100)
_WALKS = 4  # a direction: what they leave of noise evens out over stacks
_TOGETHER = 32  # stacks that are walked through
_DEEPEST = 1.2  # optical depth of films
_FILMS = (0.03, 0.4)  # alpha, from and to
_GROUNDS = (0.05, 1.0)
_SEEN, _DIRECT = 0.02, 0.03  # of the loss: a dB of what is seen, and the squares of what is missing
_STRAY = 100.0  # such squares are a walk's noise, and would drown all others


class Layering(nn.Module):
    """Latents of stacks: those of the ground, and what the film adds to them. Channels are treated
    alike, so that permuting them permutes the stack's.
    """

    def __init__(self, color_latents: int = 4, shared_latents: int = 12, width: int = 192) -> None:
        super().__init__()
        k, d = color_latents, shared_latents
        self.per_channel = mlp(k + d + 3, width, width)
        self.to_shared = mlp(2 * width, width, d)
        self.to_color = mlp(width + d, width, k)

    def forward(self, under: Latents, film: Film) -> Latents:
        """Latents of the stacks of n grounds and films."""
        each = torch.cat((under.shared, film.alpha.log()[:, None] * 0.5 + 1), 1)
        each = each[:, None].expand(-1, 3, -1)
        crossed = torch.exp(-2 * film.depth)
        given = torch.cat((under.color, each, film.depth[..., None], crossed[..., None]), 2)
        features = functional.silu(self.per_channel(given))
        shared = self.to_shared(torch.cat((features.mean(1), features.amax(1)), 1))
        added = self.to_color(torch.cat((features, shared[:, None].expand(-1, 3, -1)), 2))
        return Latents(under.color + added, under.shared + shared)


def random_stacks(n: int, g: torch.Generator) -> tuple[Film, Ground]:
    """A third each of the grounds is matte, glossy (the highlight white and weak) and metal; of the
    films a fifth is clear.
    """

    def draw(*shape: int) -> Tensor:
        return torch.rand(n, *shape, generator=g)

    def alpha(low: float, high: float) -> Tensor:
        return torch.exp(math.log(low) + math.log(high / low) * draw())

    kind = torch.randint(0, 3, (n, 1), generator=g)
    color, white = draw(3) * draw(1).sqrt(), draw(1) * 0.1
    tint = (0.3 + 0.7 * draw(3)) * draw(1).sqrt()
    ks = torch.where(kind == 0, 0, torch.where(kind == 1, white, tint))
    kd = torch.where(kind == 2, 0.02 * color, 0.97 * color) * (1 - ks)
    depth = _DEEPEST * draw(3) * draw(1).square() * (draw(1) > 0.2)
    return Film(alpha(*_FILMS), depth), Ground(kd, ks, alpha(*_GROUNDS))


@dataclass(frozen=True)
class _Stacks:
    """n films over grounds, f [n, M, 3] of the stacks at the lit directions of `views`, as halves,
    and pixels [n, ...] of these views.
    """

    film: Film
    under: Latents
    f: Tensor
    seen: Tensor


def _lit() -> Tensor:
    """Which of the directions of `views` [V D] see light."""
    return (views().weights > 0).any(1).flatten()


def _pixels(f: Tensor, lit: Tensor) -> Tensor:
    """How `f` [n, M, 3] at `lit` directions looks."""
    everywhere = f.new_zeros(len(f), len(lit), 3)
    everywhere[:, lit] = f
    return views().seen(everywhere)


def _walked(n: int, representation: Trained, g: torch.Generator) -> _Stacks:
    film, ground = random_stacks(n, g)
    lit, f, seen = _lit(), [], []
    angles = views().angles[lit]
    for start in tqdm(range(0, n, _TOGETHER), desc="stacks"):
        rows = slice(start, start + _TOGETHER)
        found = evaluate_stack(film[rows], ground[rows], angles, walks=_WALKS, generator=g)
        f.append(found.half())
        seen.append(_pixels(found, lit))
    with torch.no_grad():
        under = representation.encode_parameters(ground.states())
    return _Stacks(film, under, torch.cat(f), torch.cat(seen))


def train_layering(
    run: Run, command: str, *, stacks: int = _STACKS, iterations: int = _ITERATIONS
) -> Layering:
    """Learn what films do to random grounds, and write weights and the training's record, which
    names the `command`, to `run.base`. Raises what `train` does.

    A run that is resumed walks through the stacks again, and then goes on where it was.
    """
    check_writable(run.base)
    torch.manual_seed(run.seed)
    g = torch.Generator().manual_seed(run.seed)
    representation, identity = load_representation()
    model = _untrained(representation)
    loss = _loss(model, representation, _walked(stacks, representation, g), g)
    made_from = {"command": command, "encoder": identity, "stacks": stacks, "walks": _WALKS}
    record = train(Training(model, loss, _SCHEDULE, iterations, g, made_from), run)
    write_weights(run.base, model, record)
    remove_checkpoints(run)
    return load_layering(run.base)


def _loss(
    model: Layering, representation: Trained, known: _Stacks, g: torch.Generator
) -> Callable[[int], Tensor]:
    """Of a random batch: dB of what is seen, and at every direction the square of what is missing,
    by what there is. Squares have their least at the mean of the walks, whatever their noise.
    """
    lit = _lit()
    angles, under = views().angles[lit], known.under

    def loss(_: int) -> Tensor:
        rows = torch.randint(len(known.f), (_BATCH,), generator=g)
        below = Latents(under.color[rows], under.shared[rows])
        f = representation.decode(model(below, known.film[rows]), angles)
        missing = (f - known.f[rows].float()) / (f.detach() + FLOOR)
        seen = psnr_of(known.seen[rows], _pixels(f, lit))
        return _DIRECT * missing.square().clamp_max(_STRAY).mean() - _SEEN * seen.mean()

    return loss


def _untrained(representation: Trained) -> Layering:
    color, shared = representation.latent_sizes
    return Layering(color // 3, shared)


def load_layering(path: Path) -> Layering:
    """What `train_layering` wrote; ModelFileError where it is missing or of another encoder."""
    again = f"Train them with `python -m training layering --output {shown(path)}`."
    if not path.exists():
        raise ModelFileError(f"The trained weights of layering are missing ({shown(path)}).", again)
    representation, identity = load_representation()
    model = _untrained(representation)
    if read_weights(path, model)["run"]["encoder"] != identity:
        raise ModelFileError(f"{shown(path.name)} belongs to another encoder than ours.", again)
    return model
