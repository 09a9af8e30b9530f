"""Options of every kind, to the command line and to the worker, and streams that are closed."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

from .damage import ODD_NUMBERS, ODD_TEXTS, ODD_VALUES
from .evidence import Ended, Evidence
from .trial import Trial

__all__ = ("attempt_command", "attempt_request")

_LEAST = {"frames": 1, "size": 1, "seed": 0}
_GOOD: dict[str, tuple[Any, ...]] = {
    "frames": (1, 2, 3),
    "size": (1, 3, 8, 20),
    "seed": (0, 1, 2**31, 2**63 - 1),
    "tolerance": (1e-9, 45, 45.5, 999),
    "quality": ("draft", "balanced"),
    "temporal_model": ("auto", "constant", "affine", "lstm_parameters", "lstm_latents"),
    "specular": ("rgb", "mono"),
    "format": ("torrance-sparrow", "principled", "principled-exact"),
    "onset": ("auto", "none"),
    "sparse": (True, False),
    "device": ("auto", "cpu"),
}
_TOO_MUCH = {"frames": 10**9, "size": 16385}
_FIELDS = ("input", "ntm", "output", *_GOOD)


def attempt_request(trial: Trial) -> list[Evidence]:
    """A worker's `age` with odd settings, or with all of them good."""
    rng = trial.rng
    trial.textures()
    request = trial.request(**{name: rng.choice(_GOOD[name]) for name in rng.sample([*_GOOD], 4)})
    expected: Ended | None = None
    if rng.random() < 0.2:
        expected = "done"
    else:
        for name in rng.sample(_FIELDS, rng.choice((1, 1, 2))):
            odd = rng.choice((*ODD_VALUES, *ODD_NUMBERS))
            request[name] = odd
            if _is_wrong(name, odd):
                expected = "refused"
        if rng.random() < 0.1:
            request[rng.choice(ODD_TEXTS)] = 1
            expected = "refused"
    if _takes_long(request):
        return [trial.age(trial.request())]
    output = trial.output
    return [
        trial.age(
            request, output=output, expected=expected, writes=request["output"] == str(output)
        )
    ]


def _is_wrong(name: str, value: Any) -> bool:
    """Whether a setting must be refused, by what its refusals say of it."""
    if value is None or name == "output":
        return name in ("input", "ntm", "output") and not isinstance(value, str)
    if name in _LEAST:
        whole = isinstance(value, int) and not isinstance(value, bool)
        return not whole or value < _LEAST[name] or value >= _TOO_MUCH.get(name, value + 1)
    if name == "tolerance":
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return not number or not 0 < value < float("inf")
    if name == "sparse":
        return not isinstance(value, bool)
    return True


def _takes_long(request: dict[str, Any]) -> bool:
    """Whether a request is legal and just takes its time."""
    size, frames = request.get("size"), request.get("frames")
    large = isinstance(size, int) and 64 < size < _TOO_MUCH["size"]
    return large or (isinstance(frames, int) and 64 < frames < _TOO_MUCH["frames"])


def attempt_command(trial: Trial) -> list[Evidence]:
    """The command line itself: odd words, closed or full streams, too little memory."""
    rng = trial.rng
    trial.textures()
    match rng.randrange(4):
        case 0:
            return [_odd_words(trial)]
        case 1:
            return [_odd_streams(trial)]
        case 2:
            megabytes = rng.choice((60, 120, 200, 260, 300, 350, 400, 600))
            kind = rng.choice(("-d", "-d", "-v"))
            limit = megabytes * 1024 * (4 if kind == "-v" else 1)
            return [trial.command(*_words(trial), shell=f"ulimit {kind} {limit}; ")]
        case _:
            expected: Ended = "done"
            more = [f"--{name}={rng.choice(_GOOD[name])}" for name in ("seed", "specular", "onset")]
            return [trial.command(*_words(trial), *more, expected=expected)]


def _words(trial: Trial, **changes: Any) -> list[str]:
    words = ["age"]
    for name, value in trial.request(**changes).items():
        words += [f"--{name.replace('_', '-')}", str(value)]
    return words


def _odd_words(trial: Trial) -> Evidence:
    rng = trial.rng
    texts = [text.replace("\0", "0")[:100_000] for text in ODD_TEXTS if text.isprintable()]
    odd = [*texts, *map(str, ODD_NUMBERS), os.fsdecode(b"caf\xe9"), "\uff19", "0x10", "1_0", "1e3"]
    words = _words(trial)
    match rng.randrange(5):
        case 0 | 1:
            words[rng.randrange(2, len(words), 2)] = rng.choice(odd)
        case 2:
            words.insert(rng.randrange(len(words)), rng.choice(odd))
        case 3:
            del words[rng.randrange(len(words))]
        case 4:
            command = rng.choice(("info", "serve", "age", "", "help"))
            option = rng.choice(("--help", "--json", "--idle-minutes", "--ntm", "--x"))
            words = [command, option, rng.choice(odd)]
    given = dict(zip(words[1::2], words[2::2], strict=False))
    request = {name: _number(given.get(f"--{name}")) for name in ("size", "frames")}
    if _takes_long(request):
        words = ["info"]
    here = str(trial.output) == given.get("--output") and words[0] == "age"
    # An odd name is that of a folder where the command runs, which is its home.
    return trial.command(*words, writes=here, beside=(r"home(/|$)",))


def _number(text: str | None) -> int | None:
    try:
        return None if text is None else int(text)
    except ValueError:
        return None


def _odd_streams(trial: Trial) -> Evidence:
    """stdout that is closed, full, or that nobody reads; stderr that is closed."""
    rng = trial.rng
    words = rng.choice((_words(trial), [*_words(trial), "--json"], ["info"], ["info", "--json"]))
    writes = words[0] == "age"
    match rng.randrange(4):
        case 0:
            evidence = trial.command(*words, shell="exec 1>&-; ", writes=writes)
        case 1:
            evidence = trial.command(*words, shell="exec 1>/dev/full; ", writes=writes)
        case 2:
            return trial.command(*words, shell="exec 2>&-; ", writes=writes, expected="done")
        case _:
            reading, writing = os.pipe()
            os.close(reading)
            try:
                evidence = trial.command(*words, stdout=writing, writes=writes)
            finally:
                os.close(writing)
            if not any(evidence.answer.words):
                # Where nobody reads, to end without a word is the custom.
                evidence = replace(evidence, answer=replace(evidence.answer, ended="stopped"))
    # That a result cannot be told of is found when it is there.
    return replace(evidence, untold=True)
