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

__all__ = ("exact_group", "forward_group", "new_group", "read_back_group", "shared_group")

_NONE, _ONE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
_TINY = 1e-30
_FAR, _HUGE = 1e12, 1e30
# Small enough to be nothing, and the second by far larger than the first.
_LEAST_TINT, _LEAST_KS = (1e-10, 1e-10, 1e-10), (1e-8, 1e-8, 1e-8)

_TYPES = {
    **dict.fromkeys(("Kd", "Ks", "Vector", "Normal", "Displacement"), "NodeSocketVector"),
    **dict.fromkeys(("Base Color", "Specular Tint", "Diffuse", "Specular"), "NodeSocketColor"),
    **dict.fromkeys(("Second Color", "Second Edge"), "NodeSocketColor"),
    **dict.fromkeys(("Third Color", "Third Edge"), "NodeSocketColor"),
}
_AUTHORED = ("Base Color", "Metallic", "Specular IOR Level", "IOR", "Specular Tint")
_STRENGTHS = {
    "Grain": "How much places differ from each other: 0 is smooth, 1 as in the model's source",
    "Relief": "How much aging raises and pits the surface: 0 is flat, 1 as in the model's source",
}
"""Of 0 to 1, and what they are for."""


def forward_group() -> bpy.types.NodeTree:
    """(Kd, Ks) of Principled sockets: `principled.forward`."""
    return shared_group("Principled to Kd and Ks", _AUTHORED, ("Kd", "Ks"), _forward)


def read_back_group() -> bpy.types.NodeTree:
    """The Principled sockets nearest to those authored that have Kd and Ks: `_Texels.nearest`."""
    inputs = ("Kd", "Ks", *_AUTHORED)
    outputs = ("Base Color", "Metallic", "Specular IOR Level")
    return shared_group("Kd and Ks to Principled", inputs, outputs, _read_back)


def exact_group() -> bpy.types.NodeTree:
    """The Principled sockets that are Kd and Ks to the digit: `principled.exact`."""
    outputs = ("Base Color", "Specular Tint")
    return shared_group("Kd and Ks to Principled, Exact", ("Kd", "Ks"), outputs, _exact)


def new_group(name: str, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> bpy.types.NodeTree:
    """An empty group of ours with those sockets."""
    group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    group[GROUP] = 1
    for each in inputs:
        socket = group.interface.new_socket(each, in_out="INPUT", socket_type=_type(each))
        if each in _STRENGTHS:
            socket.description = _STRENGTHS[each]
            socket.subtype, socket.default_value = "FACTOR", 1.0
            socket.min_value, socket.max_value = 0.0, 1.0
    for each in outputs:
        group.interface.new_socket(each, in_out="OUTPUT", socket_type=_type(each))
    return group


def _type(name: str) -> str:
    return _TYPES.get(name, "NodeSocketFloat")


def shared_group(
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
        level = canvas.number("Specular IOR Level").maximum(0.0)
        f0 = canvas.triple("Specular Tint").maximum(_NONE) * (_f0_per_level(canvas) * level)
    with canvas.stage("Kd = base (1 - metallic),  Ks = base · metallic + F0 (1 - metallic)"):
        base = canvas.triple("Base Color").maximum(_NONE)
        # A mix clamps its share.
        metallic = canvas.number("Metallic")
        return {"Kd": where3(metallic, _NONE, base), "Ks": where3(metallic, base, f0)}


def _f0_per_level(canvas: Canvas) -> Number:
    ior = canvas.number("IOR").maximum(1e-5)
    ratio = (ior - 1.0) / (ior + 1.0)
    return ratio * ratio * 2.0


def _read_back(canvas: Canvas) -> dict[str, Number | Triple]:
    """The steps of `_Texels.nearest`, bounds and all for q = 1 - metallic instead of metallic; a
    division by 0 gives 0 here, and NaN or infinity there.
    """
    with canvas.stage("F0's strength along the tint"):
        authored = canvas.triple("Specular Tint").maximum(_NONE)
        tinted = greater(dot(authored, authored), _TINY)
        tint = where3(tinted, authored, _ONE).maximum(_LEAST_TINT)
        # Of what is dotted with it, the length along the tint, in tints.
        along_tint = tint * (1.0 / dot(tint, tint))
        per_level = _f0_per_level(canvas) * tinted
        most_f0 = per_level * canvas.number("Specular IOR Level").maximum(1.0)
    with canvas.stage("Kd and Ks along the tint and across"):
        kd, ks = canvas.triple("Kd"), canvas.triple("Ks")
        kd_along, ks_along = dot(kd, along_tint), dot(ks, along_tint)
        along = kd_along + ks_along
        across = kd + ks - tint * along
        ks_across = ks - tint * ks_along
    with canvas.stage("Metallic: Ks = metallic (Kd + Ks) across the tint, else as authored"):
        half = along * 0.5
        half2, weaker = half.square(), kd_along.minimum(ks_along)
        pull = weaker.square().scaled(PULL**2, half2.scaled(4e-12, _TINY))
        wanted = pull.scaled(canvas.number("Metallic").clamp(), dot(ks_across, across))
        q = 1.0 - wanted / (dot(across, across) + pull)
    with canvas.stage("q's bounds: no F0 below 0 or above its most, no base above its most"):
        root = (half2 - most_f0 * kd_along).sqrt() + half
        above, below = kd_along / root, root / most_f0.maximum(1 / _FAR)
        most_base = canvas.triple("Base Color").maximum(_ONE)
        least = (kd_along / along).maximum((kd / most_base).largest())
        # A full metal has Ks in its base color alone.
        beyond = less(least, 1e-7) * greater((ks - most_base).largest(), 0.0)
        least = beyond.scaled(below, least)
    with canvas.stage("Out of the gap between the bounds, to the nearer one"):
        q = q.maximum(least)
        in_gap = less(q, below) * greater(q, above)
        nearer = less(below - q, q - above).maximum(less(above, least))
        up = nearer * less(below, 1 + 1e-6)
        q = where(in_gap, where(up, below, above), q).maximum(least).clamp()
    with canvas.stage("F0 and the specular level"):
        # A channel without tint limits no F0, whatever its Ks.
        share = (ks.maximum(_LEAST_KS) / tint).least()
        f0 = (along - kd_along / q).minimum(share) / q
        f0 = f0.within(0.0, most_f0)
        # A mix clamps its share.
        is_free = q * (per_level * _HUGE)
        level = where(is_free, f0 / per_level, canvas.number("Specular IOR Level"))
    with canvas.stage("Base color: least squares of Kd = q base and Ks - q F0 = metallic base"):
        metallic = 1.0 - q
        base = where3(q, kd, ks - tint * (q * f0))
        base = base * (1.0 / q.scaled(q, metallic.square()))
        base = base.maximum(_NONE).minimum(most_base)
    return {"Base Color": base, "Metallic": metallic, "Specular IOR Level": level}


def _exact(canvas: Canvas) -> dict[str, Number | Triple]:
    with canvas.stage("Specular Tint = Ks / 0.8,  Base Color = Kd / (1 - max Ks)"):
        most, per_f0 = (EXACT_F0, EXACT_F0, EXACT_F0), 1 / EXACT_F0
        ks = canvas.triple("Ks").minimum(most)
        base = canvas.triple("Kd") * (1.0 / (1.0 - ks.largest()))
        base = base.minimum(_ONE)
        return {"Base Color": base, "Specular Tint": ks * (per_f0, per_f0, per_f0)}
