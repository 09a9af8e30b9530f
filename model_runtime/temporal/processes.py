"""How each process of weathering spreads, and at what pace: numbers that every pattern shares."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from .pace import Timing
from .waves import Wave, octaves, stretch_of

__all__ = ("PACE", "Growth", "Pace", "growth_of", "pace_of")

Pace = tuple[tuple[float, float], ...]

PACE = ((0.0, 0.02), (0.06, 0.04), (0.30, 0.12), (0.76, 0.76), (1.0, 0.91))
"""(share of texels, time by which that share has started): a quick start, so that the first quarter
of the timeline already shows spots, a steady border in between, and a remnant that turns last."""

_EVERYWHERE = ((0.0, 0.005), (1.0, 0.12))  # nearly at once: a slight gradient
_SETTLING = ((0.0, 0.01), (0.85, 0.45), (1.0, 0.7))  # all over, sheltered places last
_EVAPORATING = ((0.0, 0.02), (0.06, 0.04), (0.30, 0.12), (0.95, 0.62), (1.0, 0.72))  # to the end

_FLAKING = ((0.0, 0.02), (0.1, 0.10), (1.0, 0.93))  # chip by chip: a break takes no time

_ZOOM = (1 / 8, 4.0)  # smaller spots are lost on the grid, larger ones do not fit the tile


@dataclass(frozen=True)
class Growth:
    """How a process spreads. Lengths are in tile sides; time is what speed 1 needs to cross one."""

    nuclei: float  # per square tile
    clusters: tuple[float, float]  # noise cells (down, across) of the patches nuclei favor
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
    border: tuple[
        Wave, ...
    ] = ()  # what roughens it, in units of raggedness; none: octaves of grain

    def waves(self) -> Iterable[Wave]:
        """Of the border noise, ever finer."""
        return self.border or octaves(self.grain, self.gain)

    @property
    def wandering(self) -> float:
        """How far, in time, a border that was learned wanders: what is to come first outruns it."""
        return 0.5 * self.raggedness * math.hypot(*(wave.height for wave in self.border))

    def like(self, waves: tuple[Wave, ...]) -> Growth:
        """The same process along the `waves` of a source and as ragged (see `Timing`)."""
        if not waves:
            return self
        along = math.sqrt(stretch_of(waves))
        speed = math.sqrt(self.across * math.sqrt(self.down * self.up))
        lean = math.sqrt(self.down / self.up)
        clusters, grain = (math.sqrt(down * across) for down, across in (self.clusters, self.grain))
        return replace(
            self,
            clusters=(clusters / along, clusters * along),
            across=speed / along,
            down=speed * along * lean,
            up=speed * along / lean,
            grain=(grain / along, grain * along),
            raggedness=1.0,
            border=tuple(wave.scaled(1 / self.scale) for wave in waves),
        )

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
            scale=self.scale * zoom,
            border=tuple(wave.scaled(1 / zoom) for wave in self.border),
        )


# Where these numbers come from. `scale` is measured: the distance at which patterns drawn with the
# others are half alike. The others are chosen, not measured: no source gives
# them, and which pictures they were held against is not recorded. What a comment names is the real
# thing that their signs, order and proportions follow; sizes were set so that it shows.
# Throughout: `grain` cells are about the size of that thing's borders, `raggedness` grows with how
# far these wander, and `gain` runs from soft (0.45) to crumbling down to single texels (0.82).
_PROCESSES = {
    # Many small pits, nearly at once, in patches that stay wet longer: hence by far the most nuclei
    # and the shortest delays. Wet rust runs a little, so down is half again as fast as across.
    # Flakes make its border the most crumbling one, and mottle what has turned.
    "rust": Growth(
        nuclei=700, clusters=(3, 3), cluster_delay=0.08, birth_spread=0.06,
        across=1.0, down=1.5, up=0.9, unevenness=0.5, grain=(12, 12), raggedness=0.022, gain=0.82,
        mottling=0.5, scale=0.067,
    ),
    # Green where rain runs: few sites, of which the last are late (long delays), that run down four
    # times as fast as across and hardly climb; noise four times as fine across as down makes
    # streaks.
    "patina": Growth(
        nuclei=60, clusters=(3, 4), cluster_delay=0.6, birth_spread=0.2,
        across=0.35, down=1.3, up=0.2, unevenness=0.8, grain=(4, 16), raggedness=0.14, gain=0.72,
        mottling=0.35, scale=0.141,
    ),
    # Fire starts in a few places and climbs, as flames heat what is above them: up is half again as
    # fast as down. Cracks, grain and damp bend its front most (unevenness 1). Char is even.
    "char": Growth(
        nuclei=5, clusters=(2, 2), cluster_delay=0.1, birth_spread=0.15,
        across=1.0, down=0.8, up=1.25, unevenness=1.0, grain=(9, 9), raggedness=0.06, gain=0.65,
        mottling=0.3, scale=0.169,
    ),
    # Dry islands open where a surface is thin or warm, and long before the last place: the longest
    # delay. Water sinks, so they climb a little faster. Dry is dry: little mottling. Its pace ends
    # before the timeline does.
    "drying": Growth(
        nuclei=30, clusters=(3, 3), cluster_delay=0.7, birth_spread=0.15,
        across=1.0, down=0.8, up=1.1, unevenness=0.9, grain=(7, 7), raggedness=0.09, gain=0.6,
        mottling=0.15, scale=0.305, pace=_EVAPORATING,
    ),
    # Light falls on a whole surface: hardly more than a slight gradient, with broad, soft regions,
    # alike in all directions, for what is a little more or less exposed.
    "fading": Growth(
        nuclei=3, clusters=(1, 1), cluster_delay=0.3, birth_spread=0.1,
        across=1.0, down=1.0, up=1.0, unevenness=0.2, grain=(2, 2), raggedness=0.03, gain=0.6,
        mottling=0.1, scale=0.305, pace=_EVERYWHERE,
    ),
    # Many small sources on ledges and in pores, from which rain draws streaks: fifteen times as
    # fast down as up, in columns (clusters five times as fine across as down) and thin (grain seven
    # times). Deposits are as uneven as rust. Its pace covers all, sheltered places last.
    "soiling": Growth(
        nuclei=260, clusters=(2, 10), cluster_delay=0.5, birth_spread=0.3,
        across=0.3, down=2.2, up=0.15, unevenness=0.7, grain=(3, 22), raggedness=0.12, gain=0.75,
        mottling=0.5, scale=0.104, pace=_SETTLING,
    ),
    # A film of varnish turns as a whole: as fading, a little more uneven for how thickly it was
    # brushed on, and with the softest border.
    "yellowing": Growth(
        nuclei=3, clusters=(1, 1), cluster_delay=0.3, birth_spread=0.1,
        across=1.0, down=1.0, up=1.0, unevenness=0.3, grain=(3, 3), raggedness=0.04, gain=0.45,
        mottling=0.15, scale=0.304, pace=_EVERYWHERE,
    ),
    # Round cushions from some dozens of spores, alike in all directions, in damp patches; colonies
    # come over a good part of the time. Their edges crumble almost as rust does.
    "moss": Growth(
        nuclei=45, clusters=(3, 3), cluster_delay=0.35, birth_spread=0.2,
        across=1.0, down=1.0, up=1.0, unevenness=0.6, grain=(10, 10), raggedness=0.05, gain=0.8,
        mottling=0.35, scale=0.185,
    ),
    # Paint lifts and chips off from scratches and blisters: few sites, as fast to all sides, along
    # a border that breaks as it likes, to single chips.
    "peeling_metal": Growth(
        nuclei=60, clusters=(3, 3), cluster_delay=0.5, birth_spread=0.3,
        across=1.0, down=1.1, up=0.9, unevenness=0.9, grain=(12, 12), raggedness=0.06, gain=0.74,
        mottling=0.2, scale=0.12, pace=_FLAKING,
    ),
    # On wood it goes along the fibers, which lie across: four times as fast, in slivers.
    "peeling_wood": Growth(
        nuclei=160, clusters=(6, 2), cluster_delay=0.4, birth_spread=0.3,
        across=2.0, down=0.5, up=0.5, unevenness=0.9, grain=(28, 6), raggedness=0.09, gain=0.76,
        mottling=0.2, scale=0.076, pace=_FLAKING,
    ),
    # Sun and rain gray a board as a whole, board by board and along the fibers.
    "weathered_wood": Growth(
        nuclei=40, clusters=(6, 1), cluster_delay=0.5, birth_spread=0.3,
        across=2.0, down=0.6, up=0.6, unevenness=0.7, grain=(20, 4), raggedness=0.15, gain=0.72,
        mottling=0.4, scale=0.085, pace=_SETTLING,
    ),
}  # fmt: skip
# Any other process, of which nothing is known: round spots, middling in everything.
_SPOTS = Growth(
    nuclei=120, clusters=(3, 3), cluster_delay=0.15, birth_spread=0.1,
    across=1.0, down=1.0, up=1.0, unevenness=0.5, grain=(8, 8), raggedness=0.03, gain=0.55,
    mottling=0.3, scale=0.13,
)  # fmt: skip


def growth_of(process: str, timing: Timing | None) -> Growth:
    """How `process` spreads, with the waves and at the scale of its `timing` where these are known;
    any name will do.
    """
    growth = _PROCESSES.get(process, _SPOTS)
    return growth if timing is None else growth.like(timing.waves).zoomed(timing.scale)


def pace_of(values: tuple[float, ...]) -> Pace:
    """As a pace: (share of texels, value)."""
    return tuple((k / (len(values) - 1), value) for k, value in enumerate(values))
