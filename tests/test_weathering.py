"""The procedural weathering sequences: broad starts, plausible colors, histories one can learn."""

from __future__ import annotations

import numpy as np
import pytest

from model_runtime.errors import InputError, OutputError
from model_runtime.temporal.onset import onset_map, rate_map
from model_runtime.temporal.pace import Timing
from training.data.kinetics import PROCESSES, history, wetted
from training.data.sequences import Sequence, read_sequence
from training.data.weathering import generate, initial_values, write
from training.data.weathering_materials import draw

MATERIALS = {
    "steel": ((0.02, 0.02, 0.02), (0.55, 0.55, 0.54), 0.2),
    "blue paint": ((0.03, 0.12, 0.45), (0.04, 0.04, 0.04), 0.15),
    "copper": ((0.02, 0.01, 0.01), (0.9, 0.56, 0.42), 0.2),
    "oak": ((0.35, 0.2, 0.1), (0.04, 0.04, 0.04), 0.3),
    "red plastic": ((0.6, 0.05, 0.03), (0.045, 0.045, 0.045), 0.1),
    "stone": ((0.4, 0.37, 0.32), (0.03, 0.03, 0.03), 0.7),
    "wet stone": ((0.18, 0.16, 0.13), (0.03, 0.03, 0.03), 0.05),
    "enamel": ((0.8, 0.79, 0.76), (0.05, 0.05, 0.05), 0.04),
}
SPREADING = {
    "rust": ("steel", "blue paint"),
    "patina": ("copper",),
    "char": ("oak",),
    "drying": ("wet stone",),
    "soiling": ("enamel", "stone"),
    "moss": ("stone",),
}
EVERYWHERE = {"fading": ("red plastic", "blue paint"), "yellowing": ("enamel", "blue paint")}
FOREIGN = {
    "rust": "copper",
    "patina": "stone",
    "char": "steel",
    "drying": "stone",
    "fading": "steel",
    "soiling": "copper",
    "yellowing": "stone",
    "moss": "enamel",
}
AGES = np.linspace(0, 1, 36)


def ages(process, material, age):
    kd, ks, alpha = (np.array(v, np.float32) for v in MATERIALS[material])
    return history(process, kd, ks, alpha, np.array(age, np.float32))


def tone_mapped(kd, ks, alpha):
    """Looks of a texel lit evenly, without and with a lamp in the mirror direction (both cosines
    0.8).
    """
    lobe = 1 / (np.pi * alpha[..., None] ** 2) / (4 * 0.64)
    even = kd + 0.5 * ks
    return 1 - np.exp(-2 * np.concatenate((even, even + 0.05 * np.minimum(ks * lobe, 20)), -1))


def saturation(color):
    """How far the darkest channel lies below the brightest one: 0 for gray, 1 for pure."""
    return np.ptp(color, axis=-1) / color.max(-1)


@pytest.fixture(scope="module", params=sorted(PROCESSES))
def sequence(request):
    return generate(request.param, size=64, seed=3)


@pytest.mark.parametrize("process", PROCESSES)
def test_a_history_begins_at_the_material_itself(process):
    for material, values in MATERIALS.items():
        for aged, initial in zip(ages(process, material, 0.0), values, strict=True):
            np.testing.assert_array_equal(aged, np.array(initial, np.float32))


@pytest.mark.parametrize("process", SPREADING)
def test_what_spreads_turns_soon_and_then_goes_on_slowly(process):
    for material in SPREADING[process]:
        looks = tone_mapped(*ages(process, material, AGES))
        change = np.abs(looks - looks[0]).max(-1)
        assert change[round(0.1 * 35)] > 0.1, material  # visible by a local age of 0.1,
        steps = np.abs(np.diff(looks, axis=0)).max(-1)
        assert steps.max() < 0.7, material  # without a jump between frames,
        assert steps[7:].max() < 0.08, material  # slow after that,
        assert np.abs(looks[-1] - looks[7]).max() > 0.03, material  # and not at an end


@pytest.mark.parametrize("process", EVERYWHERE)
def test_what_happens_everywhere_takes_its_time(process):
    for material in EVERYWHERE[process]:
        looks = tone_mapped(*ages(process, material, AGES))
        change = np.abs(looks - looks[0]).max(-1)
        assert np.abs(np.diff(looks, axis=0)).max() < 0.06, material
        assert 0.2 * change[-1] < change[12] < 0.85 * change[-1], material
        assert change[-1] > 0.1, material


def test_rust_is_orange_then_dark_brown():
    for material in SPREADING["rust"]:
        kd, ks, alpha = ages("rust", material, [0.12, 1.0])
        red, green, blue = kd.T
        assert (red > 1.8 * green).all()
        assert (green > 1.3 * blue).all()
        assert red[0] > 0.2
        assert red[1] < 0.6 * red[0]
        assert ks.max() < 0.08
        assert alpha[-1] > 0.5


def test_copper_is_brown_before_it_is_green():
    kd, ks, alpha = ages("patina", "copper", [0.08, 1.0])
    red, green, blue = kd.T
    assert red[0] > green[0] > blue[0]
    assert green[1] > blue[1] > red[1]
    assert green[1] > 1.5 * red[1]
    assert ks[-1].max() < 0.1
    assert alpha[-1] > 0.5


def test_wood_is_black_before_it_is_ash():
    kd, _, alpha = ages("char", "oak", [0.03, 0.25, 1.0])
    toasted, black, ash = kd
    assert toasted[0] > 2 * toasted[2]  # brown,
    assert black.max() < 0.04  # then black,
    assert ash.min() > 1.5 * black.max()  # then gray
    assert np.ptp(ash) < 0.2 * ash.max()
    assert alpha[-1] > alpha[1]


def test_what_dries_grows_brighter_paler_and_rougher():
    kd, ks, alpha = ages("drying", "wet stone", AGES)
    assert (np.diff(kd, axis=0) >= 0).all()
    assert (np.diff(alpha) >= 0).all()
    assert (np.diff(ks, axis=0) <= 0).all()
    assert saturation(kd[-1]) < saturation(kd[0])
    assert alpha[-1] > 0.5


def test_a_wetted_surface_dries_to_what_it_was():
    """Wet sand, soil and concrete are about half as bright (Angstrom 1925; Twomey et al. 1986)."""
    dry = np.array((0.4, 0.25, 0.12), np.float32)
    film = np.full(3, 0.03, np.float32)
    wet = wetted(dry) * (1 - film)
    assert ((0.33 * dry < wet) & (wet < 0.6 * dry)).all()
    assert saturation(wet) > saturation(dry)
    alpha, age = (np.array(v, np.float32) for v in (0.05, 1.0))
    again, ks, _ = history("drying", wet, film, alpha, age)
    np.testing.assert_allclose(again, dry * (1 - film), rtol=0.02)
    assert ks.max() < film.min()


def test_dyes_lose_their_saturation_and_lighten():
    for material in EVERYWHERE["fading"]:
        kd, ks, alpha = ages("fading", material, AGES)
        assert (np.diff(saturation(kd)) < 0).all()
        assert (np.diff(kd.mean(-1)) > 0).all()
        assert saturation(kd[-1]) < 0.6 * saturation(kd[0])
        assert alpha[0] < alpha[-1] < 0.5
        assert ks[-1].max() < ks[0].min()


def test_red_dyes_fade_sooner_than_blue_ones():
    red, blue = (ages("fading", m, 0.3)[0] for m in ("red plastic", "blue paint"))
    before = {m: saturation(np.array(MATERIALS[m][0])) for m in ("red plastic", "blue paint")}
    assert saturation(red) / before["red plastic"] < saturation(blue) / before["blue paint"]


def test_soil_buries_color_and_gloss():
    ends = []
    for material in SPREADING["soiling"]:
        kd, ks, alpha = ages("soiling", material, AGES)
        red, green, blue = kd[-1]
        assert red > green > blue  # a warm gray-brown,
        assert red < 1.9 * blue
        assert kd[-1].max() < 0.25  # dark,
        assert ks[-1].max() < 0.1 * ks[0].min()  # without a highlight
        assert (np.diff(alpha) >= 0).all()
        steps = -np.diff(kd.mean(-1))
        assert steps[0] > 4 * steps[-1] > 0  # saturating
        ends.append(kd[-1])
    assert np.ptp(ends, axis=0).max() < 0.1  # whatever lies under it


def test_varnish_takes_blue_most_and_a_little_gloss():
    for material in EVERYWHERE["yellowing"]:
        kd, ks, alpha = ages("yellowing", material, AGES)
        assert (np.diff(kd, axis=0) < 0).all()
        red, green, blue = kd[-1] / kd[0]
        assert red > 0.8
        assert red > green > 1.5 * blue
        assert 0.7 < (ks[-1] / ks[0]).min() < 1
        assert alpha[0] < alpha[-1] < alpha[0] + 0.1


def test_moss_is_green_and_ends_brownish():
    kd, ks, alpha = ages("moss", "stone", AGES)
    red, green, blue = kd.T
    grown = slice(15, 20)
    assert (green[grown] > 1.5 * red[grown]).all()
    assert (green[grown] > 3 * blue[grown]).all()
    assert green[grown].max() < 0.5 * green[0]
    assert red[-1] / green[-1] > 1.3 * (red[grown] / green[grown]).max()
    assert green[-1] > 2 * blue[-1]
    assert ks[-1].max() < 0.02
    assert alpha[-1] > 0.85


def test_the_end_depends_on_the_beginning():
    for process in PROCESSES:
        ends = [ages(process, material, 1.0)[0] for material in MATERIALS]
        assert np.ptp(ends, axis=0).max() > 0.01, process


@pytest.mark.parametrize("process", PROCESSES)
def test_a_process_meets_what_fits_it_and_nothing_else(process):
    """In a space of equal steps, square roots, fitting materials lie near and foreign ones far."""
    rng = np.random.default_rng(1)
    met = np.sqrt(np.stack([draw(process, rng) for _ in range(4000)]))

    def distance(material: str) -> float:
        kd, ks, alpha = MATERIALS[material]
        return float(np.linalg.norm(met - np.sqrt((*kd, *ks, alpha)), axis=1).min())

    fitting = (SPREADING | EVERYWHERE)[process]
    assert max(map(distance, fitting)) < 0.12
    assert distance(FOREIGN[process]) > 0.15


@pytest.mark.parametrize("process", PROCESSES)
def test_a_patchwork_shows_what_the_process_meets(process):
    maps = initial_values(process, size=64, rng=np.random.default_rng(1))
    texels = np.sqrt(np.concatenate([m.reshape(64 * 64, -1) for m in maps], -1))
    rng = np.random.default_rng(2)
    met = np.sqrt([draw(process, rng) for _ in range(60)])
    distance = np.linalg.norm(met[:, None] - texels, axis=-1).min(1)
    assert np.median(distance) < 0.12


def test_values_can_be_rendered_and_all_three_change(sequence):
    assert sequence.alpha.shape == (36, 64, 64)
    assert np.isfinite(sequence.kd).all()
    assert not sequence.out_of_range().any()
    assert (sequence.kd + sequence.ks).max() <= 1
    for values in (sequence.kd, sequence.ks, sequence.alpha):
        assert np.abs(values[-1] - values[0]).mean() > 0.002
    assert np.abs(sequence.kd[-1] - sequence.kd[0]).mean() > 0.02


def test_half_of_the_texels_show_their_whole_history(sequence):
    assert sequence.onset is not None
    assert np.mean(sequence.onset == 0) == pytest.approx(0.5, abs=0.05)


def test_its_timing_is_that_of_the_process(sequence):
    """Not of the texels that were started early for their histories' sake."""
    process = sequence.name.split("-")[0]
    assert sequence.timing == Timing.of(
        *(make(process, (64, 64), seed=3) for make in (onset_map, rate_map))
    )
    assert sequence.timing.onset[0] > 0


def test_a_texel_is_a_function_of_its_start_and_local_age(sequence):
    """Nothing hidden: what a model of z(0) cannot know does not enter."""
    process = sequence.name.split("-")[0]
    start = (sequence.kd[0], sequence.ks[0], sequence.alpha[0])
    for k in (1, 9, 35):
        aged = history(process, *start, np.maximum(0, sequence.times[k] - sequence.onset))
        np.testing.assert_array_equal(aged[0], sequence.kd[k])
        np.testing.assert_array_equal(aged[2], sequence.alpha[k])


def test_the_seed_decides():
    first, again, other = (generate("rust", size=16, frames=3, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.kd, again.kd)
    assert not np.allclose(first.kd, other.kd)


def test_a_written_folder_reads_back(tmp_path):
    made = write("char", tmp_path / "a" / "char", size=12, frames=4, seed=5)
    read = read_sequence(tmp_path / "a" / "char")
    for name in ("kd", "ks", "alpha", "onset"):  # stored as half floats: 11 bits
        np.testing.assert_allclose(getattr(read, name), getattr(made, name), rtol=1e-3, atol=1e-6)
    np.testing.assert_array_equal(read.times, made.times)
    assert isinstance(read, Sequence) and read.timing == made.timing

    write("char", tmp_path / "a" / "char", size=12, frames=3, seed=5)
    shorter = read_sequence(tmp_path / "a" / "char")
    assert isinstance(shorter, Sequence)
    assert len(shorter.times) == 3


def test_what_cannot_be_made_is_refused(tmp_path):
    with pytest.raises(InputError, match="no process named 'frost'"):
        generate("frost")
    with pytest.raises(InputError, match="cannot have 1 frames"):
        generate("rust", frames=1)
    with pytest.raises(InputError, match="0 x 0"):
        generate("rust", size=0)
    for size, frames in ((4, 1001), (17000, 2), (10**9, 10**9)):
        with pytest.raises(InputError, match=f"{frames} frames of {size} x {size}"):
            generate("rust", size=size, frames=frames)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot be written"):
        write("rust", tmp_path / "file" / "below", size=4, frames=2)


def test_frames_of_somebody_else_are_not_replaced(tmp_path):
    (tmp_path / "kd_0007.exr").write_bytes(b"a day's work")
    for described in (None, '{"times": [0, 1]}'):
        if described is not None:
            (tmp_path / "sequence.json").write_text(described)
        with pytest.raises(OutputError, match="has not written"):
            write("rust", tmp_path, size=4, frames=2)
        assert (tmp_path / "kd_0007.exr").read_bytes() == b"a day's work"
        assert not (tmp_path / "kd_0001.exr").exists()
