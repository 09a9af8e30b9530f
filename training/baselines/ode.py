"""An equation of appearance: noise flows to a texture, and the texture flows on as it ages.

C. Liu, T. Ritschel: Neural Differential Appearance Equations. ACM Transactions on Graphics 43(6),
2024, written from the paper at a size that a core trains in an hour. The rival that learns the
change of a texture's statistics over time from a film and nothing else: dz/dt = f(z, t) with a
small U-Net f, from noise z(-1) over the first picture's texture z(0) to the last one's z(1). The
first three channels of a state show; the others are the network's own. Theirs are larger, train on
a GPU, and have a second kind whose states are maps that a flash lights; ours are colors.

Where theirs begins anew from noise after some steps of training, and goes on from the state that it
has come to between, so does this: every step integrates one segment of time, and its end is held
against a picture of that moment.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from model_runtime.errors import UsageError
from model_runtime.reading.inputs import hash_file

from ..data.location import data_folder
from ..loop import Run, Schedule, Training, remove_checkpoints, train
from ..metric.texture import TextureMetric, encoded
from ..source.pictures import read_pictures
from .weights import read_weights, write_weights

__all__ = ("Flow", "load_flow", "play", "train_flow")

Array = NDArray[np.float32]

_CHANNELS = 12
_WIDTHS = (32, 64, 64)
_OCTAVES = 6  # of time
_BEGIN = -1.0  # when there is noise
_SEGMENTS = 6  # from noise to noise; the first ends at 0, the others share 0 to 1
_STEPS = 4  # of Heun's method, in a segment
_BRIGHTNESS = (0.25, 0.5)  # of a state's values as colors: noise begins in range
_BEYOND = 1.0  # weight of colors out of range
_DIRECTIONS = 32
_PLACES = 4096  # of a layer that are looked at
_MULTIPLE = 4  # sides of states are halved twice


@dataclass(frozen=True)
class Config:
    """How it learns: states of `side` texels a side, `iterations` segments at a `rate` that has
    risen after `warm_up` of them.
    """

    side: int = 64
    iterations: int = 20_000
    rate: float = 1e-3
    warm_up: int = 100


class Flow(nn.Module):
    """dz/dt at states z [B, 12, H, W] and a time t: a U-Net of three levels that wraps."""

    def __init__(self) -> None:
        super().__init__()
        fine, middle, coarse = _WIDTHS
        sizes = (
            (_CHANNELS, fine), (fine, fine), (fine, middle), (middle, middle),
            (middle, coarse), (coarse, middle), (middle, fine), (fine, fine),
        )  # fmt: skip
        self.convolutions = nn.ModuleList(
            nn.Conv2d(inputs, outputs, 3, padding=1, padding_mode="circular")
            for inputs, outputs in sizes
        )
        self.clock = nn.Sequential(
            nn.Linear(2 * _OCTAVES, 64),
            nn.SiLU(),
            nn.Linear(64, 2 * sum(each[1] for each in sizes)),
        )
        self.last = nn.Conv2d(fine, _CHANNELS, 1)
        for each in self.last.parameters():
            nn.init.zeros_(each)
        self._sizes = [each[1] for each in sizes]

    def forward(self, z: Tensor, t: float) -> Tensor:
        octaves = math.pi / 4 * t * 2.0 ** torch.arange(_OCTAVES)
        told = self.clock(torch.cat((octaves.sin(), octaves.cos())))
        told = told[:, None, None].split([2 * size for size in self._sizes])

        def layer(k: int, x: Tensor) -> Tensor:
            scale, shift = told[k].chunk(2)
            return functional.silu(self.convolutions[k](x) * (1 + scale) + shift)

        fine = layer(1, layer(0, z))
        middle = layer(3, layer(2, functional.avg_pool2d(fine, 2)))
        coarse = layer(5, layer(4, functional.avg_pool2d(middle, 2)))
        middle = layer(6, middle + functional.interpolate(coarse, scale_factor=2.0))
        fine = layer(7, fine + functional.interpolate(middle, scale_factor=2.0))
        return self.last(fine)


def _flown(flow: Flow, z: Tensor, start: float, end: float, steps: int) -> Tensor:
    """The state at `end` of one that is `z` at `start`, by so many steps of Heun's method."""
    for before, after in pairwise(np.linspace(start, end, steps + 1).tolist()):
        step = after - before
        slope = flow(z, before)
        z = z + step / 2 * (slope + flow(z + step * slope, after))
    return z


def _colors(z: Tensor) -> Tensor:
    """What states show, sRGB; out of 0..1 where they are."""
    contrast, mean = _BRIGHTNESS
    return z[:, :3] * contrast + mean


def play(flow: Flow, size: tuple[int, int], times: Array, seed: int = 0) -> Array:
    """Colors [T, H, W, 3] (sRGB) at rising `times` [T], 0 to 1, of noise drawn from `seed`, with
    steps as long as it has learned with on average, or shorter.

    Raises UsageError for sizes that are no multiple of 4.
    """
    if any(side % _MULTIPLE for side in size):
        raise UsageError(f"A side of {size} is no multiple of {_MULTIPLE}.", "Take others.")
    g = torch.Generator().manual_seed(seed)
    pictures = []
    with torch.no_grad():
        z = _flown(flow, torch.randn(1, _CHANNELS, *size, generator=g), _BEGIN, 0.0, _STEPS)
        for before, now in pairwise((0.0, *times.tolist())):
            steps = math.ceil((now - before) * (_SEGMENTS - 1) * _STEPS - 1e-6)
            z = _flown(flow, z, before, now, steps)
            pictures.append(_colors(z)[0].clamp(0, 1).permute(1, 2, 0).numpy())
    return np.stack(pictures)


@dataclass
class _Learning:
    """One training: what every frame of a film shows to the metric's network, and a flow that
    has come to `z` at time `now`, both of them kept in its checkpoint.
    """

    flow: Flow
    metric: TextureMetric
    seen: list[list[Tensor]]
    generator: torch.Generator

    def loss(self, step: int) -> Tensor:
        """How far the end of the next segment is from what the film shows then."""
        segment, g = step % _SEGMENTS, self.generator
        if segment == 0:
            shape = self.flow.get_buffer("z").shape
            z, now, end = torch.randn(shape, generator=g), _BEGIN, 0.0
        else:
            z, now = self.flow.get_buffer("z"), float(self.flow.get_buffer("now"))
            end = (segment - float(torch.rand((), generator=g))) / (_SEGMENTS - 1)
            end = max(end, now)
        z = _flown(self.flow, z, now, end, _STEPS)
        self.flow.register_buffer("z", z.detach())
        self.flow.register_buffer("now", torch.tensor(end))
        colors = _colors(z)
        truth = self.seen[round(end * (len(self.seen) - 1))]
        beyond = (colors - colors.clamp(0, 1)).abs().mean()
        return self._apart(colors[0].clamp(-0.5, 1.5), truth) + _BEYOND * beyond

    def _apart(self, colors: Tensor, truth: list[Tensor]) -> Tensor:
        """Sliced Wasserstein distances, squared, in variances of the truth; their mean over the
        layers.
        """
        g, parts = self.generator, []
        for mine, theirs in zip(self.metric.features(colors), truth, strict=True):
            values = mine.flatten(1)
            directions = torch.randn(len(values), _DIRECTIONS, generator=g)
            directions = (directions / directions.norm(dim=0)).T
            count = min(values.shape[1], theirs.shape[1])
            ours, asked = (_drawn(each, count, g) for each in (values, theirs.float()))
            ours, asked = directions @ ours, directions @ asked
            spread = asked.var(1).clamp_min(1e-8)
            apart = (ours.sort(1).values - asked.sort(1).values).square().mean(1)
            parts.append((apart / spread).mean())
        return torch.stack(parts).mean()


def _drawn(values: Tensor, count: int, g: torch.Generator) -> Tensor:
    """So many of the places of `values` [C, N], at random."""
    if values.shape[1] == count:
        return values
    return values[:, torch.randperm(values.shape[1], generator=g)[:count]]


def train_film(film: Path, rows: str, run: Run, command: str, credit: str) -> Flow:
    """`train_flow` of the `rows` (upper, lower or all) of a film; what is written says by which
    `command` and whose film it is.
    """
    frames = encoded(read_pictures(film))
    middle = frames.shape[1] // 2
    half = {"upper": slice(0, middle), "lower": slice(middle, None), "all": slice(None)}[rows]
    metric = TextureMetric.load(data_folder() / "perceptual")
    told = {"command": command, "film": hash_file(film), "credit": credit}
    return train_flow(frames[:, half], metric, run, Config(), told)


def train_flow(
    frames: Array, metric: TextureMetric, run: Run, config: Config, told: Mapping[str, str]
) -> Flow:
    """Learn from a film's `frames` [T, H, W, 3] (sRGB), and write weights and the training's
    record, with what is `told` of them, to `run.base`. Raises what `train` does.
    """
    torch.manual_seed(run.seed)
    flow, g = Flow(), torch.Generator().manual_seed(run.seed)
    flow.register_buffer("z", torch.zeros(1, _CHANNELS, config.side, config.side))
    flow.register_buffer("now", torch.zeros(()))
    seen = [_seen(metric, frame, g) for frame in frames]
    learning = _Learning(flow, metric, seen, g)
    made_from = {"config": vars(config), **told}
    schedule = Schedule(config.rate, config.warm_up, floor=0.02)
    training = Training(flow, learning.loss, schedule, config.iterations, g, made_from)
    record = train(training, run)
    write_weights(run.base, flow, record)
    remove_checkpoints(run)
    return load_flow(run.base)


def _seen(metric: TextureMetric, frame: Array, g: torch.Generator) -> list[Tensor]:
    """Some places of each layer [C, N], as halves: all frames are kept in memory."""
    colors = torch.from_numpy(np.ascontiguousarray(frame)).permute(2, 0, 1)
    with torch.no_grad():
        layers = [each.flatten(1) for each in metric.features(colors)]
    return [_drawn(each, min(_PLACES, each.shape[1]), g).half() for each in layers]


def load_flow(path: Path) -> Flow:
    """What `train_flow` wrote."""
    flow = Flow()
    read_weights(path, flow)
    return flow
