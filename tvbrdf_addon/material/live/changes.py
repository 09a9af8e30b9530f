"""What age does to a state: color ramps of the curves, weighted by each texel's coefficients."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....model_runtime.channels import ROUGHNESS_MIN, WIDTH, optics
from ....model_runtime.contract import COEFFICIENTS_A_FILE
from ....model_runtime.live.evaluate import Curves
from ..nodes.strengths import GRAIN
from ..result import LiveFiles
from .formula import Canvas, Number, Numeric, Triple, dot
from .stops import Array, stops_of

__all__ = ("State", "Texture", "changed")

_NONE = (0.0, 0.0, 0.0)

Texture = Callable[[Path, str], Triple]


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
    count = len(curves.shapes)
    raised: Numeric = depth
    halves: Numeric = 0.5
    for number, shape in enumerate(curves.shapes):
        channel = number % COEFFICIENTS_A_FILE
        if channel == 0:
            with canvas.stage("Coefficients"):
                texel = texture(maps.coefficients[number // COEFFICIENTS_A_FILE], "Coefficients")
                here = np.arange(number, min(number + COEFFICIENTS_A_FILE, count))
                texel = _with_grain(canvas, texel, here >= count - maps.grain)
                shares = texel.channels()
                depths = [_depth(each) for each in curves.shapes[number:][:COEFFICIENTS_A_FILE]]
                red, green, blue = depths + [0.0] * (COEFFICIENTS_A_FILE - len(depths))
                raised = dot(texel, (red, green, blue)) + raised
                if maps.height:
                    halves = dot(texel, (0.5, 0.5, 0.5)) + halves
        with canvas.stage(f"+ coefficient · change {number + 1}"):
            change = _ramps(canvas, local, shape, most, depths[channel])
            total = change.weighted(shares[channel], total, level=maps.height)
    with canvas.stage("Gain · authored + offset + changes, and its limits"):
        kd = start.kd.scaled(gain.kd, total.kd) - raised
        ks = start.ks.scaled(gain.ks, total.ks) - raised
        roughness = start.roughness.scaled(gain.roughness, total.roughness) - raised
        roughness = roughness.maximum(ROUGHNESS_MIN).minimum(1.0)
        state = State(kd.maximum(_NONE), ks.maximum(_NONE), roughness)
    if not maps.height:
        return state, None
    with canvas.stage("Height"):
        return state, (total.level - halves) * (2 * most)


def _with_grain(canvas: Canvas, texel: Triple, is_grain: NDArray[np.bool_]) -> Triple:
    """Coefficients, those that are grain as strong as the artist says."""
    if not is_grain.any():
        return texel
    grain = canvas.number(GRAIN)
    if is_grain.all():
        return texel * grain
    mean = (~is_grain).astype(float).tolist()
    red, green, blue = mean + [0.0] * (COEFFICIENTS_A_FILE - len(mean))
    return texel * (red, green, blue) + texel * (1 - red, 1 - green, 1 - blue) * grain


def _depth(curve: Array) -> float:
    return max(-float(curve[:, :WIDTH].min()), 0.0)


def _ramps(canvas: Canvas, local: Number, curve: Array, most: float, depth: float = 0.0) -> _Change:
    """One of the curves [T, C] at the local age, raised by `depth`: a ramp for Kd and roughness,
    one for Ks and the height, which nowhere is more than `most`.
    """
    kd, ks, r = optics(curve + depth)
    level = (curve[:, WIDTH] / most + 1) / 2
    shown_kd, roughness = _ramp(canvas, local, np.column_stack((kd, r)), "Kd, roughness as alpha")
    shown_ks, height = _ramp(canvas, local, np.column_stack((ks, level)), "Ks, height as alpha")
    return _Change(shown_kd, shown_ks, roughness, height)


def _ramp(canvas: Canvas, local: Number, curve: Array, label: str) -> tuple[Triple, Number]:
    """A curve [T, 4] as color and alpha."""
    stops = stops_of(curve)
    node = canvas.add("ShaderNodeValToRGB", local, label=label)
    elements = node.color_ramp.elements
    for position in stops.positions[1:-1]:
        elements.new(position)
    for element, value in zip(elements, stops.values, strict=True):
        element.color = value
    return Triple(canvas, node.outputs["Color"]), Number(canvas, node.outputs["Alpha"])
