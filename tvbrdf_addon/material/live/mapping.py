"""Between Principled and Torrance-Sparrow as math nodes: `brdf/principled.py`, symbol by symbol.

These groups are shared by all aged materials of a file.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy

from ....model_runtime.brdf.principled import EXACT_F0, PULL
from ..nodes.ownership import GROUP
from .arrange import arrange
from .formula import Canvas, Number, Triple, dot, greater, less, where, where3

__all__ = ("exact_group", "forward_group", "new_group", "read_back_group")

_TINY = 1e-30
_FAR = 1e12

_TYPES = {
    **dict.fromkeys(("Kd", "Ks", "Vector"), "NodeSocketVector"),
    **dict.fromkeys(("Base Color", "Specular Tint", "Diffuse", "Specular"), "NodeSocketColor"),
}
_AUTHORED = ("Base Color", "Metallic", "Specular IOR Level", "IOR", "Specular Tint")


def forward_group() -> bpy.types.NodeTree:
    """(Kd, Ks) of Principled sockets: `principled.forward`."""
    return _shared("Principled to Kd and Ks", _AUTHORED, ("Kd", "Ks"), _forward)


def read_back_group() -> bpy.types.NodeTree:
    """The Principled sockets nearest to those authored that have Kd and Ks: `_Texels.nearest`."""
    inputs = ("Kd", "Ks", *_AUTHORED)
    outputs = ("Base Color", "Metallic", "Specular IOR Level")
    return _shared("Kd and Ks to Principled", inputs, outputs, _read_back)


def exact_group() -> bpy.types.NodeTree:
    """The Principled sockets that are Kd and Ks to the digit: `principled.exact`."""
    outputs = ("Base Color", "Specular Tint")
    return _shared("Kd and Ks to Principled, Exact", ("Kd", "Ks"), outputs, _exact)


def new_group(name: str, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> bpy.types.NodeTree:
    """An empty group of ours with those sockets."""
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    group[GROUP] = 1
    for each in inputs:
        group.interface.new_socket(each, in_out="INPUT", socket_type=_type(each))
    for each in outputs:
        group.interface.new_socket(each, in_out="OUTPUT", socket_type=_type(each))
    return group


def _type(name: str) -> str:
    return _TYPES.get(name, "NodeSocketFloat")


def _shared(
    name: str,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    build: Callable[[Canvas], dict[str, Number | Triple]],
) -> bpy.types.NodeTree:
    """The file's own group of that name; built where there is none."""
    for group in bpy.data.node_groups:
        if group.get(GROUP) == name and group.library is None:
            return group
    group = new_group(name, inputs, outputs)
    group[GROUP] = name
    canvas = Canvas(group)
    given = build(canvas)
    with canvas.stage("Result"):
        canvas.give(given)
    arrange(group)
    return group


def _forward(canvas: Canvas) -> dict[str, Number | Triple]:
    with canvas.stage("F0 = 2 ((n - 1) / (n + 1))² · level · tint"):
        ratio = _ratio(canvas)
        level = canvas.number("Specular IOR Level").maximum(0.0)
        f0 = canvas.triple("Specular Tint").maximum((0.0, 0.0, 0.0)) * (ratio * ratio * 2.0 * level)
    with canvas.stage("Kd = base (1 - metallic),  Ks = base · metallic + F0 (1 - metallic)"):
        base = canvas.triple("Base Color").maximum((0.0, 0.0, 0.0))
        metallic = canvas.number("Metallic").clamp()
        dielectric = 1.0 - metallic
        return {"Kd": base * dielectric, "Ks": base * metallic + f0 * dielectric}


def _ratio(canvas: Canvas) -> Number:
    ior = canvas.number("IOR").maximum(1e-5)
    return (ior - 1.0) / (ior + 1.0)


def _read_back(canvas: Canvas) -> dict[str, Number | Triple]:
    """The steps of `_Texels.nearest`; a division by 0 gives 0 here, and NaN or infinity there."""
    none, one = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    with canvas.stage("F0's strength along the tint"):
        authored = canvas.triple("Specular Tint").maximum(none)
        tinted = greater(dot(authored, authored), _TINY)
        tint = where3(tinted, authored, one)
        tint2 = dot(tint, tint)
        ratio = _ratio(canvas)
        per_level = ratio * ratio * 2.0 * tinted
        most_level = canvas.number("Specular IOR Level").maximum(1.0)
        most_f0 = per_level * most_level
    with canvas.stage("Kd and Ks along the tint and across"):
        kd, ks = canvas.triple("Kd").maximum(none), canvas.triple("Ks").maximum(none)
        kd_along, ks_along = dot(kd, tint) / tint2, dot(ks, tint) / tint2
        along = kd_along + ks_along
        across = kd + ks - tint * along
        ks_across = ks - tint * ks_along
    with canvas.stage("Metallic: Ks = metallic (Kd + Ks) across the tint, else as authored"):
        pull = (kd_along.minimum(ks_along) * PULL).square() + (along * 1e-6).square() + _TINY
        wanted = dot(ks_across, across) + pull * canvas.number("Metallic").clamp()
        metallic = wanted / (dot(across, across) + pull)
    with canvas.stage("Its bounds: no F0 below 0 or above its most, no base color above its most"):
        discriminant = along.square() - most_f0 * kd_along * 4.0
        root = discriminant.sqrt() + along
        least = 1.0 - kd_along * 2.0 / root
        other = 1.0 - root / (most_f0 * 2.0).maximum(1 / _FAR)
        most_base = canvas.triple("Base Color").maximum(one)
        most = (1.0 - kd_along / along).minimum(1.0 - (kd / most_base).largest())
        full_metal = 1.0 - less(most, 1.0)
        beyond = full_metal * greater((ks - most_base).largest(), 0.0)
        most = where(beyond, most.minimum(other), most)
    with canvas.stage("Out of the gap between the bounds, to the nearer one"):
        metallic = metallic.minimum(most)
        in_gap = greater(metallic, other) * less(metallic, least) * (1.0 - less(discriminant, 0.0))
        nearer = less(metallic - other, least - metallic).maximum(greater(least, most))
        down = nearer * greater(other, -1e-6)
        metallic = where(in_gap, where(down, other, least), metallic).minimum(most).clamp()
    with canvas.stage("F0 and the specular level"):
        q = 1.0 - metallic
        untinted = tint.minimum(one).ceil().scaled((-_FAR, -_FAR, -_FAR), (_FAR, _FAR, _FAR))
        share = (ks / tint + untinted).least()
        f0 = ((along * q - kd_along) / q.square()).minimum(share / q)
        f0 = f0.maximum(0.0).minimum(most_f0)
        free = (1.0 - greater(q, 0.0)).maximum(1.0 - greater(per_level, 0.0))
        level = where(
            free, canvas.number("Specular IOR Level"), (f0 / per_level).minimum(most_level)
        )
    with canvas.stage("Base color: least squares of Kd = q base and Ks - q F0 = metallic base"):
        base = (ks - tint * (q * f0)) * metallic + kd * q
        base = base * (1.0 / (q.square() + metallic.square()))
        base = base.maximum(none).minimum(most_base)
    return {"Base Color": base, "Metallic": metallic, "Specular IOR Level": level}


def _exact(canvas: Canvas) -> dict[str, Number | Triple]:
    with canvas.stage("Specular Tint = Ks / 0.8,  Base Color = Kd / (1 - max Ks)"):
        most, per_f0 = (EXACT_F0, EXACT_F0, EXACT_F0), 1 / EXACT_F0
        ks = canvas.triple("Ks").maximum((0.0, 0.0, 0.0)).minimum(most)
        base = canvas.triple("Kd") * (1.0 / (1.0 - ks.largest()))
        base = base.maximum((0.0, 0.0, 0.0)).minimum((1.0, 1.0, 1.0))
        return {"Base Color": base, "Specular Tint": ks * (per_f0, per_f0, per_f0)}
