"""What a run will take: the formula, learning from runs, and saying it."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from tvbrdf.tvbrdf_addon.estimate import in_bytes, in_time
from tvbrdf.tvbrdf_addon.rates import Rates, Work

BALANCED = Work(texels=1024 * 1024, frames=36, quality="balanced", temporal_model="affine")


def report(work: Work, **seconds: float) -> dict:
    stages = {"read": 0.4, "onset": 0.1, "model": 0.5, "write": 5.0} | seconds
    return {
        "size": [1024, work.texels // 1024],
        "frames": work.frames,
        "quality": work.quality,
        "temporal_model": work.temporal_model,
        "seconds": stages,
    }


def test_time_and_disk_grow_with_frames_and_texels():
    rates = Rates(overhead=0.0)
    once = rates.of(BALANCED)
    twice = rates.of(Work(BALANCED.texels, 72, "balanced", "affine"))
    assert twice.bytes == pytest.approx(2 * once.bytes)
    assert once.seconds < twice.seconds <= 2 * once.seconds


def test_exact_through_latents_takes_hours():
    """0.011 s a texel."""
    exact = Work(1024 * 1024, 36, "exact", "lstm_latents")
    assert in_time(Rates().of(exact).seconds) == "3 hours"
    assert in_time(Rates().of(BALANCED).seconds) == "7 s"


def test_runs_are_learned_from():
    rates, took = Rates(), {"read": 1.0, "onset": 0.5, "model": 4.0, "write": 60.0}
    for _ in range(12):
        rates = rates.after(report(BALANCED, **took), stored=400_000_000)
    assert rates.of(BALANCED).seconds == pytest.approx(sum(took.values()), rel=0.02)
    assert rates.of(BALANCED).bytes == pytest.approx(400e6, rel=0.02)
    draft = Work(BALANCED.texels, 36, "draft", "affine")
    assert replace(rates, overhead=0.6).of(draft) == Rates().of(draft), "nothing was learned of it"


def test_one_odd_run_says_little_and_many_are_the_rule():
    slow = report(BALANCED, **dict.fromkeys(("read", "onset", "model", "write"), 500.0))
    once = Rates().after(slow, stored=1)
    assert once.of(BALANCED).seconds < 2.1 * Rates().of(BALANCED).seconds
    often = once
    for _ in range(20):
        often = often.after(slow, stored=1)
    assert often.of(BALANCED).seconds == pytest.approx(2000, rel=0.02)


def test_a_run_of_one_size_tells_of_others():
    """What a surface takes at any size, and what is fitted once, are told from what grows."""

    def took(texels: int) -> dict[str, float]:
        onset = 1.5 * (1.3 + 5e-7 * texels)
        return {"read": 0.2, "onset": onset, "model": 0.1, "fit": 2.0, "write": 3e-7 * texels}

    small, large = (
        Work(texels, 36, "balanced", "affine", live=True, grows=True)
        for texels in (1 << 20, 1 << 24)
    )
    rates = Rates()
    for _ in range(8):
        aged = report(small, **took(small.texels)) | {"binding": "live", "surface": {}}
        rates = rates.after(aged, stored=10 << 20, before=1.0, maps=4.0)
    for work in (small, large):
        expected = 1.0 + sum(took(work.texels).values())
        assert rates.of(work).seconds == pytest.approx(expected, rel=0.05)
    with_maps = rates.of(replace(small, maps=True)).seconds
    assert with_maps == pytest.approx(rates.of(small).seconds + 4.0, rel=0.02)


def test_a_short_run_says_nothing_of_writing():
    small = Work(1024 * 16, 2, "balanced", "affine")
    learned = Rates().after(report(small), stored=10_000_000)
    assert (learned.write, learned.stored) == (Rates().write, Rates().stored)


def test_rates_are_kept(tmp_path: Path):
    rates = Rates().after(report(BALANCED), stored=200_000_000)
    rates.save(tmp_path / "rates.json")
    assert Rates.load(tmp_path / "rates.json") == rates


@pytest.mark.parametrize(
    "text",
    [
        *("", "[]", "{", '{"write": 6e-7}', '{"model": 3}', '{"x": 1}', "[" * 100_000),
        *('{"overhead": NaN}', '{"overhead": Infinity}', '{"overhead": -1}', '{"overhead": "1"}'),
        *(
            '{"write": {"draft": NaN}}',
            '{"stored": {"x": null}}',
            f'{{"overhead": 1{400 * "0"}}}',
        ),
    ],
    ids=lambda text: text[:24],
)
def test_a_broken_file_of_rates_is_forgotten(tmp_path: Path, text: str):
    (tmp_path / "rates.json").write_text(text)
    assert Rates.load(tmp_path / "rates.json") == Rates()
    assert Rates.load(tmp_path / "none.json") == Rates.load(None) == Rates()


def test_a_file_of_rates_that_never_ends_is_left_at_once(tmp_path: Path):
    os.mkfifo(tmp_path / "rates.json")
    assert Rates.load(tmp_path / "rates.json") == Rates()


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.2, "1 s"),
        (8.4, "8 s"),
        (23, "25 s"),
        (88, "90 s"),
        (100, "2 min"),
        (1300, "20 min"),
        (5500, "2 hours"),
        (52000, "15 hours"),
        (500_000, "6 days"),
        (40_000_000, "450 days"),
        (1e12, "over 100 years"),
        (float("inf"), "over 100 years"),
        (float("nan"), "over 100 years"),
        (10**400, "over 100 years"),
    ],
)
def test_time_is_said_no_finer_than_a_guess(seconds: float, said: str):
    assert in_time(seconds) == said


@pytest.mark.parametrize(
    ("count", "said"),
    [
        *((1e5, "1 MB"), (8.3e6, "8 MB"), (312e6, "300 MB"), (1.26e9, "1.3 GB"), (24e9, "25 GB")),
        *((1e30, "over 1,000,000 TB"), (float("inf"), "over 1,000,000 TB")),
    ],
)
def test_disk_use_is_rounded(count: float, said: str):
    assert in_bytes(count) == said


def test_a_live_result_costs_the_same_however_many_frames_it_shows():
    rates = Rates()
    few, many = (
        rates.of(Work(BALANCED.texels, frames, "balanced", "affine", live=True))
        for frames in (9, 900)
    )
    assert few == many
    assert few.bytes < rates.of(BALANCED).bytes / 10
    aged = {"size": [1024, 1024], "frames": 36, "quality": "balanced", "temporal_model": "affine"}
    aged |= {"binding": "live", "seconds": dict.fromkeys(("read", "onset", "model", "fit"), 0.1)}
    aged["seconds"]["write"] = 0.4
    learned = rates.after(aged, stored=6 << 20)
    assert learned.write["balanced"] == rates.write["balanced"]
    assert learned.of(Work(BALANCED.texels, 36, "balanced", "affine", live=True)).bytes < few.bytes


def test_the_start_of_the_worker_counts_where_it_is_cold():
    rates = Rates()
    cold = rates.of(replace(BALANCED, cold=True)).seconds
    assert cold - rates.of(BALANCED).seconds == pytest.approx(rates.start)
    assert rates.after(report(BALANCED), 1000).start == rates.start, "it was there"
    assert rates.after(report(BALANCED), 1000, start=5.0).start == pytest.approx(4.0)
