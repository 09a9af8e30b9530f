"""The procedural weathering sequences: broad starts, plausible colours, histories one can learn."""

from __future__ import annotations

import numpy as np
import pytest

from model_runtime.errors import InputError, OutputError
from training.data.kinetics import PROCESSES, history
from training.data.sequences import Sequence, read_sequence
from training.data.weathering import generate, write

MATERIALS = {
    "steel": ((0.02, 0.02, 0.02), (0.55, 0.55, 0.54), 0.2),
    "blue paint": ((0.03, 0.12, 0.45), (0.04, 0.04, 0.04), 0.15),
    "copper": ((0.02, 0.01, 0.01), (0.9, 0.56, 0.42), 0.2),
    "oak": ((0.35, 0.2, 0.1), (0.04, 0.04, 0.04), 0.3),
}
SOURCES = {"rust": ("steel", "blue paint"), "patina": ("copper",), "char": ("oak",)}


def ages(process, material, age):
    kd, ks, alpha = (np.array(v, np.float32) for v in MATERIALS[material])
    return history(process, kd, ks, alpha, np.array(age, np.float32))


def tone_mapped(kd, ks, alpha):
    """Looks of a texel lit evenly and by a lamp in the mirror direction (both cosines 0.8)."""
    lobe = 1 / (np.pi * alpha[..., None] ** 2) / (4 * 0.64)
    return 1 - np.exp(-2 * (kd + 0.5 * ks + 0.05 * np.minimum(ks * lobe, 20)))


@pytest.fixture(scope="module", params=sorted(PROCESSES))
def sequence(request):
    return generate(request.param, size=64, seed=3)


@pytest.mark.parametrize("process", PROCESSES)
def test_a_history_begins_at_the_material_itself(process):
    for material, values in MATERIALS.items():
        for aged, initial in zip(ages(process, material, 0.0), values, strict=True):
            np.testing.assert_array_equal(aged, np.array(initial, np.float32))


@pytest.mark.parametrize("process", PROCESSES)
def test_it_turns_soon_and_then_goes_on_slowly(process):
    for material in SOURCES[process]:
        looks = tone_mapped(*ages(process, material, np.linspace(0, 1, 36)))
        change = np.abs(looks - looks[0]).max(-1)
        assert change[round(0.1 * 35)] > 0.1, material  # visible by a local age of 0.1,
        steps = np.abs(np.diff(looks, axis=0)).max(-1)
        assert steps.max() < 0.7, material  # without a jump between frames,
        assert steps[7:].max() < 0.08, material  # slow after that,
        assert np.abs(looks[-1] - looks[7]).max() > 0.05, material  # and not at an end


def test_rust_is_orange_then_dark_brown():
    for material in SOURCES["rust"]:
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
    assert ash.min() > 1.5 * black.max()  # then grey
    assert np.ptp(ash) < 0.2 * ash.max()
    assert alpha[-1] > alpha[1]


def test_the_end_depends_on_the_beginning():
    for process in PROCESSES:
        ends = [ages(process, material, 1.0)[0] for material in MATERIALS]
        assert np.ptp(ends, axis=0).max() > 0.01, process


def test_texels_cover_metals_and_coatings_smooth_and_rough(sequence):
    kd, ks, alpha = sequence.kd[0], sequence.ks[0].mean(-1), sequence.alpha[0]
    assert np.mean(ks > 0.3) > 0.02
    assert np.mean(ks < 0.09) > 0.02
    low, high = np.quantile(alpha, (0.05, 0.95))
    assert low < 0.05
    assert high > 0.4
    assert np.quantile(kd, 0.99) > 0.4


def test_values_can_be_rendered_and_all_three_change(sequence):
    assert sequence.alpha.shape == (36, 64, 64)
    assert np.isfinite(sequence.kd).all()
    assert not sequence.out_of_range().any()
    assert max(sequence.kd.max(), sequence.ks.max()) <= 1
    for values in (sequence.kd, sequence.ks, sequence.alpha):
        assert np.abs(values[-1] - values[0]).mean() > 0.02


def test_half_of_the_texels_show_their_whole_history(sequence):
    assert sequence.onset is not None
    assert np.mean(sequence.onset == 0) == pytest.approx(0.5, abs=0.05)


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
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot be written"):
        write("rust", tmp_path / "file" / "below", size=4, frames=2)
