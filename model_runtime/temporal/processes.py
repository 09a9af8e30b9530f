"""How each process of weathering spreads, and at what pace: numbers that every pattern shares."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .pace import Timing

__all__ = ("PACE", "Growth", "Pace", "growth_of", "pace_of")

Pace = tuple[tuple[float, float], ...]

PACE = ((0.0, 0.02), (0.06, 0.04), (0.30, 0.12), (0.76, 0.76), (1.0, 0.91))
"""(share of texels, time by which that share has started): a quick start, so that the first quarter
of the timeline already shows spots, a steady border in between, and a remnant that turns last."""

_EVERYWHERE = ((0.0, 0.005), (1.0, 0.12))  # nearly at once: a slight gradient
_SETTLING = ((0.0, 0.01), (0.85, 0.45), (1.0, 0.7))  # all over, sheltered places last
_EVAPORATING = ((0.0, 0.02), (0.06, 0.04), (0.30, 0.12), (0.95, 0.62), (1.0, 0.72))  # to the end

_ZOOM = (1 / 8, 4.0)  # smaller spots are lost on the grid, larger ones do not fit the tile


@dataclass(frozen=True)
class Growth:
    """How a process spreads. Lengths are in tile sides; time is what speed 1 needs to cross one."""

    nuclei: float  # per square tile
    clusters: tuple[float, float]  # noise cells (down, across) of the patches nuclei favour
    cluster_delay: float  # births lag by up to about this outside the patches
    birth_spread: float  # and by up to this at random
    across: float  # speeds
    down: float
    up: float
    unevenness: float  # log-amplitude of the slowness
    grain: tuple[float, float]  # noise cells (down, across) of the slowness and border noise
    raggedness: float  # amplitude of the border noise's first octave, in time
    gain: float  # amplitude ratio from one octave to the next finer one
    mottling: float  # log-amplitude by which histories run slower in places
    scale: float  # distance at which its onsets are half alike, where a tile holds many of them
    pace: Pace = PACE

    def zoomed(self, scale: float | None) -> Growth:
        """The same pattern, magnified until its onsets are half alike at the distance `scale`."""
        if scale is None:
            return self
        zoom = min(max(scale / self.scale, _ZOOM[0]), _ZOOM[1])
        return replace(
            self,
            nuclei=self.nuclei / zoom**2,
            clusters=(self.clusters[0] / zoom, self.clusters[1] / zoom),
            grain=(self.grain[0] / zoom, self.grain[1] / zoom),
            across=self.across * zoom,
            down=self.down * zoom,
            up=self.up * zoom,
        )


_PROCESSES = {
    "rust": Growth(
        nuclei=700, clusters=(3, 3), cluster_delay=0.08, birth_spread=0.06,
        across=1.0, down=1.5, up=0.9, unevenness=0.5, grain=(12, 12), raggedness=0.022, gain=0.82,
        mottling=0.5, scale=0.067,
    ),
    "patina": Growth(
        nuclei=60, clusters=(3, 4), cluster_delay=0.6, birth_spread=0.2,
        across=0.35, down=1.3, up=0.2, unevenness=0.8, grain=(4, 16), raggedness=0.14, gain=0.72,
        mottling=0.35, scale=0.141,
    ),
    "char": Growth(
        nuclei=5, clusters=(2, 2), cluster_delay=0.1, birth_spread=0.15,
        across=1.0, down=0.8, up=1.25, unevenness=1.0, grain=(9, 9), raggedness=0.06, gain=0.65,
        mottling=0.3, scale=0.169,
    ),
    "drying": Growth(
        nuclei=30, clusters=(3, 3), cluster_delay=0.7, birth_spread=0.15,
        across=1.0, down=0.8, up=1.1, unevenness=0.9, grain=(7, 7), raggedness=0.09, gain=0.6,
        mottling=0.15, scale=0.305, pace=_EVAPORATING,
    ),
    "fading": Growth(
        nuclei=3, clusters=(1, 1), cluster_delay=0.3, birth_spread=0.1,
        across=1.0, down=1.0, up=1.0, unevenness=0.2, grain=(2, 2), raggedness=0.03, gain=0.6,
        mottling=0.1, scale=0.305, pace=_EVERYWHERE,
    ),
    "soiling": Growth(
        nuclei=260, clusters=(2, 10), cluster_delay=0.5, birth_spread=0.3,
        across=0.3, down=2.2, up=0.15, unevenness=0.7, grain=(3, 22), raggedness=0.12, gain=0.75,
        mottling=0.5, scale=0.104, pace=_SETTLING,
    ),
    "yellowing": Growth(
        nuclei=3, clusters=(1, 1), cluster_delay=0.3, birth_spread=0.1,
        across=1.0, down=1.0, up=1.0, unevenness=0.3, grain=(3, 3), raggedness=0.04, gain=0.45,
        mottling=0.15, scale=0.304, pace=_EVERYWHERE,
    ),
    "moss": Growth(
        nuclei=45, clusters=(3, 3), cluster_delay=0.35, birth_spread=0.2,
        across=1.0, down=1.0, up=1.0, unevenness=0.6, grain=(10, 10), raggedness=0.05, gain=0.8,
        mottling=0.35, scale=0.185,
    ),
}  # fmt: skip
_SPOTS = Growth(
    nuclei=120, clusters=(3, 3), cluster_delay=0.15, birth_spread=0.1,
    across=1.0, down=1.0, up=1.0, unevenness=0.5, grain=(8, 8), raggedness=0.03, gain=0.55,
    mottling=0.3, scale=0.13,
)  # fmt: skip


def growth_of(process: str, timing: Timing | None) -> Growth:
    """How `process` spreads, at the scale of its `timing` where that is known; any name will do."""
    growth = _PROCESSES.get(process, _SPOTS)
    return growth if timing is None else growth.zoomed(timing.scale)


def pace_of(values: tuple[float, ...]) -> Pace:
    """As a pace: (share of texels, value)."""
    return tuple((k / (len(values) - 1), value) for k, value in enumerate(values))
