"""Models of change, from the simplest up: each maps a state at age 0 to its whole history.

A state is a vector [D]: the channels of a state (`channels`), or latents. A
history is [T, D], its T ages evenly spaced from 0 to 1; its first entry is the state itself.
"""

from __future__ import annotations

from typing import Protocol

from ..backend import Tensor, nn, torch
from ..channels import WIDTH

__all__ = ("Affine", "Constant", "LatentLSTM", "ParameterLSTM", "TemporalModel")


class TemporalModel(Protocol):
    """Anything that rolls states [N, D] forward into histories [N, T, D]."""

    def rollout(self, state: Tensor, frames: int) -> Tensor: ...


class Constant:
    """Nothing changes."""

    def rollout(self, state: Tensor, frames: int) -> Tensor:
        """`state` [N, D] repeated: [N, frames, D]."""
        return state[:, None].expand(-1, frames, -1)


class Affine:
    """x_c(a) = gain_c(a) x_c(0) + offset_c(a), channel by channel: two numbers a channel and
    age.
    """

    LARGEST_GAIN = 4.0

    def __init__(self, gain: Tensor, offset: Tensor) -> None:
        """`gain`, `offset`: [T, D], 1 and 0 at age 0."""
        self.gain, self.offset = gain, offset

    @classmethod
    def fit(cls, histories: Tensor, observed: Tensor) -> Affine:
        """Least squares on `histories` [N, T, D] where `observed` [N, T].

        Gains stay within 0..4: the paper's S1 needs up to 3, S2 up to 2.25; beyond is noise. An age
        that nothing was observed at is as the one before.
        """
        weight = observed.to(histories.dtype)[..., None]
        count = weight.sum(0).clamp_min(1)
        start = histories[:, :1]
        mean_start = (weight * start).sum(0) / count
        mean = (weight * histories).sum(0) / count
        spread = start - mean_start
        variance = (weight * spread.square()).sum(0) / count
        covariance = (weight * spread * (histories - mean)).sum(0) / count
        gain = (covariance / variance.clamp_min(1e-8)).clamp(0, cls.LARGEST_GAIN)
        gain = torch.where(variance > 1e-8, gain, torch.ones_like(gain))
        gain[0] = 1
        offset = mean - gain * mean_start
        offset[0] = 0
        for age in (~observed.any(0)).nonzero()[:, 0].tolist():
            gain[age], offset[age] = gain[max(age - 1, 0)], offset[max(age - 1, 0)]
        return cls(gain, offset)

    def rollout(self, state: Tensor, frames: int) -> Tensor:
        """Histories [N, frames, D]."""
        assert frames == len(self.gain)
        return self.gain * state[:, None] + self.offset


class ParameterLSTM(nn.Module):
    """One LSTM on standardized parameters that sees the present and the initial state.

    Its output is a residual step, so that an untrained model is `Constant`.
    """

    mean: Tensor
    scale: Tensor

    LIMIT = 8.0  # standard deviations beyond which no rollout may run away

    def __init__(self, dimensions: int = WIDTH, width: int = 64) -> None:
        super().__init__()
        self.cell = nn.LSTMCell(2 * dimensions, width)
        self.step = nn.Linear(width, dimensions)
        nn.init.zeros_(self.step.weight)
        nn.init.zeros_(self.step.bias)
        self.register_buffer("mean", torch.zeros(dimensions))
        self.register_buffer("scale", torch.ones(dimensions))

    def standardize(self, histories: Tensor) -> None:
        """Take mean and scale from `histories` [..., D]."""
        flat = histories.reshape(-1, histories.shape[-1])
        self.mean.copy_(flat.mean(0))
        self.scale.copy_(flat.std(0).clamp_min(1e-3))

    def rollout(self, state: Tensor, frames: int) -> Tensor:
        """Histories [N, frames, D]."""
        first = ((state - self.mean) / self.scale).clamp(-self.LIMIT, self.LIMIT)
        present, memory = first, None
        steps = [state]
        for _ in range(frames - 1):
            memory = self.cell(torch.cat((present, first), 1), memory)
            present = (present + self.step(memory[0])).clamp(-self.LIMIT, self.LIMIT)
            steps.append(present * self.scale + self.mean)
        return torch.stack(steps, 1)


class LatentLSTM(nn.Module):
    """The paper's NTM (section 3.2, figure 4): two LSTMs, for color and for shared latents.

    Each reads the present latent and adds a residual step to it; neither sees the other.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, color: int, shared: int, width: int = 64) -> None:
        """`color` = 3 k numbers for the color channels, `shared` = d for all."""
        super().__init__()
        self.sizes = (color, shared)
        self.cells = nn.ModuleList(nn.LSTMCell(size, width) for size in self.sizes)
        self.steps = nn.ModuleList(nn.Linear(width, size) for size in self.sizes)
        for tensor in self.steps.parameters():
            nn.init.zeros_(tensor)
        self.register_buffer("mean", torch.zeros(color + shared))
        self.register_buffer("scale", torch.ones(color + shared))

    standardize = ParameterLSTM.standardize

    def rollout(self, state: Tensor, frames: int) -> Tensor:
        """Histories [N, frames, color + shared] of flat latents [N, color + shared]."""
        limit = ParameterLSTM.LIMIT
        present = list(((state - self.mean) / self.scale).clamp(-limit, limit).split(self.sizes, 1))
        memories: list[tuple[Tensor, Tensor] | None] = [None, None]
        steps = [state]
        for _ in range(frames - 1):
            for i, (cell, step) in enumerate(zip(self.cells, self.steps, strict=True)):
                memory = cell(present[i], memories[i])
                memories[i] = memory
                present[i] = (present[i] + step(memory[0])).clamp(-limit, limit)
            steps.append(torch.cat(present, 1) * self.scale + self.mean)
        return torch.stack(steps, 1)
