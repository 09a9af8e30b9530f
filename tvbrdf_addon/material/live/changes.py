"""What age does to a state: color ramps of the curves, weighted by each texel's coefficients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....model_runtime.channels import ROUGHNESS_MIN, WIDTH, optics
from ....model_runtime.live.evaluate import Curves
from ..nodes.strengths import GRAIN
from ..result import LiveFiles
from .formula import Canvas, Number, Numeric, Triple, dot
from .stops import Array, stops_of

__all__ = ("State", "Texel", "Texture", "changed", "ramp")

_NONE = (0.0, 0.0, 0.0)


class Texel(NamedTuple):
    """What a texture shows of an image, four numbers."""

    color: Triple
    alpha: Number

    def channels(self) -> tuple[Number, Number, Number, Number]:
        return (*self.color.channels(), self.alpha)

    def weighted(self, weights: Sequence[float], rest: Numeric) -> Numeric:
        """The sum of at most four channels, times their weights, and the rest."""
        if not any(weights):
            return rest
        red, green, blue, alpha = (*weights, 0.0, 0.0, 0.0)[:4]
        total = dot(self.color, (red, green, blue)) + rest
        return self.alpha.scaled(alpha, total) if alpha else total


Texture = Callable[[Path, str], Texel]


class State(NamedTuple):
    """Torrance-Sparrow parameters, or what is done with them."""

    kd: Triple
    ks: Triple
    roughness: Number


class _Change(NamedTuple):
    """One of the curves at the local age; its height as a level from 0 to 1."""

    kd: Triple
    ks: Triple
    roughness: Number
    level: Number

    def weighted(self, share: Number, rest: _Change, *, level: bool) -> _Change:
        """`share` times this, and the rest."""
        return _Change(
            self.kd.scaled(share, rest.kd),
            self.ks.scaled(share, rest.ks),
            self.roughness.scaled(share, rest.roughness),
            self.level.scaled(share, rest.level) if level else rest.level,
        )


def changed(
    canvas: Canvas, start: State, local: Number, curves: Curves, maps: LiveFiles, texture: Texture
) -> tuple[State, Number | None]:
    """y(a) = G(a) y0 + O(a) + sum_k c_k V_k(a), and the height, which starts from 0, if there is.

    As a ramp holds nothing below 0, O and V_k are raised by their depths D, at once for all
    channels, and O's and sum_k c_k D_k are taken off the sum.  Heights h are a thousand times less
    than reflectances, and fill their ramps: (h / h_most + 1) / 2.
    """
    heights = (curves.offset[:, WIDTH:], curves.shapes[..., WIDTH:])
    most = max(float(np.abs(each).max(initial=0)) for each in heights) or 1.0
    with canvas.stage("Gain"):
        gain = _ramps(canvas, local, curves.gain, most)
    with canvas.stage("Offset"):
        depth = _depth(curves.offset)
        total = _ramps(canvas, local, curves.offset, most, depth)
    count, packing = len(curves.shapes), maps.packing
    raised: Numeric = depth
    halves: Numeric = 0.5
    for number, shape in enumerate(curves.shapes):
        channel = number % packing.in_each
        if channel == 0:
            with canvas.stage("Coefficients"):
                texel = texture(maps.coefficients[number // packing.in_each], "Coefficients")
                here = np.arange(number, min(number + packing.in_each, count))
                texel = _with_grain(canvas, texel, here >= count - maps.grain, packing.grain_zero)
                shares = texel.channels()
                depths = [_depth(each) for each in curves.shapes[here]]
                raised = texel.weighted(depths, raised)
                if maps.height:
                    halves = texel.weighted([0.5] * len(here), halves)
        with canvas.stage(f"+ coefficient · change {number + 1}"):
            change = _ramps(canvas, local, shape, most, depths[channel])
            total = change.weighted(shares[channel], total, level=maps.height)
    with canvas.stage("Gain · authored + offset + changes, and its limits"):
        kd = start.kd.scaled(gain.kd, total.kd) - raised
        ks = start.ks.scaled(gain.ks, total.ks) - raised
        roughness = start.roughness.scaled(gain.roughness, total.roughness) - raised
        roughness = roughness.within(ROUGHNESS_MIN, 1.0)
        state = State(kd.maximum(_NONE), ks.maximum(_NONE), roughness)
    if not maps.height:
        return state, None
    with canvas.stage("Height"):
        return state, (total.level - halves) * (2 * most)


def _with_grain(canvas: Canvas, texel: Texel, is_grain: NDArray[np.bool_], zero: float) -> Texel:
    """Coefficients, those that are grain without their `zero` and as strong as the artist says."""
    if not is_grain.any():
        return texel
    grain, (color, alpha) = canvas.number(GRAIN), texel
    if is_grain[3:].any():
        alpha = (alpha - zero) * grain
    if is_grain[:3].all():
        return Texel((color - (zero, zero, zero)) * grain, alpha)
    red, green, blue = (*is_grain[:3].astype(float).tolist(), 0.0, 0.0)[:3]
    own = color.scaled((red, green, blue), (-zero * red, -zero * green, -zero * blue)) * grain
    return Texel(color.scaled((1 - red, 1 - green, 1 - blue), own), alpha)


def _depth(curve: Array) -> float:
    return max(-float(curve[:, :WIDTH].min()), 0.0)


def _ramps(canvas: Canvas, local: Number, curve: Array, most: float, depth: float = 0.0) -> _Change:
    """One of the curves [T, C] at the local age, raised by `depth`: a ramp for Kd and roughness,
    one for Ks and the height, which nowhere is more than `most`.
    """
    kd, ks, r = optics(curve + depth)
    level = (curve[:, WIDTH] / most + 1) / 2
    shown_kd, roughness = ramp(canvas, local, np.column_stack((kd, r)), "Kd, roughness as alpha")
    shown_ks, height = ramp(canvas, local, np.column_stack((ks, level)), "Ks, height as alpha")
    return _Change(shown_kd, shown_ks, roughness, height)


def ramp(canvas: Canvas, local: Number, curve: Array, label: str) -> tuple[Triple, Number]:
    """A curve [T, 4] as color and alpha."""
    stops = stops_of(curve)
    node = canvas.add("ShaderNodeValToRGB", local, label=label)
    elements = node.color_ramp.elements
    for position in stops.positions[1:-1]:
        elements.new(position)
    # At once: after each of them Blender would ask what that changes in the file.
    elements.foreach_set("color", stops.values.astype(np.float32).ravel())
    return Triple(canvas, node.outputs["Color"]), Number(canvas, node.outputs["Alpha"])
