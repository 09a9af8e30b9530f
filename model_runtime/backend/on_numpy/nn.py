"""Layers of networks that are only asked, never trained, as `torch.nn` names them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Self

import numpy as np

from .products import matmul, times
from .tensor import Array, Number, Tensor

__all__ = (
    "LSTMCell",
    "Linear",
    "Module",
    "ModuleList",
    "Parameter",
    "Sequential",
    "SiLU",
    "functional",
    "init",
)

_BLOCK = 1 << 14  # numbers at a time: what they need stays in the cache


class Parameter(Tensor):
    """A tensor that a module stores."""

    __slots__ = ()


class Module:
    """Has parameters, buffers and other modules as attributes; is called for its `forward`."""

    def __init__(self) -> None:
        self._stored: set[str] = set()

    def register_buffer(self, name: str, value: Tensor, persistent: bool = True) -> None:
        setattr(self, name, value)
        if persistent:
            self._stored.add(name)

    def forward(self, *arguments: Any) -> Any:
        raise NotImplementedError

    def __call__(self, *arguments: Any) -> Any:
        return self.forward(*arguments)

    def state_dict(self) -> dict[str, Tensor]:
        """All that is stored, by dotted names."""
        found: dict[str, Tensor] = {}
        for name, value in vars(self).items():
            if isinstance(value, Parameter) or name in self._stored:
                found[name] = value
            elif isinstance(value, Module):
                found |= {f"{name}.{key}": each for key, each in value.state_dict().items()}
        return found

    def parameters(self) -> Iterator[Tensor]:
        return (value for value in self.state_dict().values() if isinstance(value, Parameter))

    def load_state_dict(self, tensors: Mapping[str, Tensor]) -> None:
        """Take what is stored from `tensors`; RuntimeError where names or shapes are others."""
        own = self.state_dict()
        if own.keys() != tensors.keys():
            raise RuntimeError(f"{sorted(own.keys() ^ tensors.keys())} do not fit")
        for name, value in own.items():
            if value.shape != tensors[name].shape:
                raise RuntimeError(f"{name} does not fit")
            value.array[...] = tensors[name].array

    def eval(self) -> Self:
        return self

    def requires_grad_(self, _wanted: bool) -> Self:
        return self


class ModuleList(Module):
    """Modules by number."""

    def __init__(self, modules: Iterable[Module]) -> None:
        super().__init__()
        for number, module in enumerate(modules):
            setattr(self, str(number), module)

    def __iter__(self) -> Iterator[Module]:
        return (each for each in vars(self).values() if isinstance(each, Module))

    def __getitem__(self, number: int) -> Module:
        return list(self)[number]


class Sequential(ModuleList):
    """One after the other."""

    def __init__(self, *modules: Module) -> None:
        super().__init__(modules)

    def forward(self, x: Tensor) -> Tensor:
        for module in self:
            x = module(x)
        return x


class Linear(Module):
    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.weight, self.bias = Parameter(_zeros(outputs, inputs)), Parameter(_zeros(outputs))

    def forward(self, x: Tensor) -> Tensor:
        product = matmul(x, self.weight.T)
        product += self.bias
        return product


class SiLU(Module):
    def forward(self, x: Tensor) -> Tensor:
        return functional.silu(x)


class LSTMCell(Module):
    """Gates in PyTorch's order: input, forget, cell, output."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        self.weight_ih = Parameter(_zeros(4 * width, inputs))
        self.weight_hh = Parameter(_zeros(4 * width, width))
        self.bias_ih, self.bias_hh = Parameter(_zeros(4 * width)), Parameter(_zeros(4 * width))

    def forward(self, x: Tensor, memory: tuple[Tensor, Tensor] | None) -> tuple[Tensor, Tensor]:
        """The next memory: hidden and cell states [N, W]."""
        gates = times(x.array, self.weight_ih.array.T)
        gates += self.bias_ih.array + self.bias_hh.array
        if memory is not None:
            gates += times(memory[0].array, self.weight_hh.array.T)
        width = gates.shape[1] // 4
        taken, kept, new, shown = (gates[:, at * width : (at + 1) * width] for at in range(4))
        cell = _sigmoid(taken) * np.tanh(new)
        if memory is not None:
            cell += _sigmoid(kept) * memory[1].array
        return Tensor(_sigmoid(shown) * np.tanh(cell)), Tensor(cell)


class functional:
    """As `torch.nn.functional`."""

    @staticmethod
    def silu(x: Tensor) -> Tensor:
        """x sigmoid(x)"""
        flat = np.ascontiguousarray(x.array).reshape(-1)
        found = np.empty_like(flat)
        for start in range(0, len(flat), _BLOCK):
            part = flat[start : start + _BLOCK]
            some = np.negative(part, out=found[start : start + _BLOCK])
            np.exp(some, out=some)
            some += 1
            np.divide(part, some, out=some)
        return Tensor(found.reshape(x.shape))

    @staticmethod
    def pad(x: Tensor, widths: tuple[int, ...], *, value: Number = 0) -> Tensor:
        """`widths` before and after the last axis, then before and after that before it, ..."""
        pairs = [(0, 0)] * (x.ndim - len(widths) // 2)
        pairs += list(zip(widths[::2], widths[1::2], strict=True))[::-1]
        return Tensor(np.pad(x.array, pairs, constant_values=value))

    @staticmethod
    def normalize(x: Tensor, *, dim: int) -> Tensor:
        length = np.sqrt(np.square(x.array).sum(dim, keepdims=True))
        return Tensor(x.array / np.maximum(length, x.dtype.type(1e-12)))


class init:
    @staticmethod
    def zeros_(x: Tensor) -> None:
        x.array[...] = 0


def _zeros(*shape: int) -> Array:
    return np.zeros(shape, np.float32)


def _sigmoid(x: Array) -> Array:
    found = np.negative(x)
    np.exp(found, out=found)
    found += 1
    return np.reciprocal(found, out=found)
