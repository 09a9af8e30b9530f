"""Model files that are damaged, hostile or of another kind: refused with a sentence."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch

from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import (
    FORMAT_VERSION,
    list_models,
    load_model,
    read_card,
    save_model,
)
from tests.model_bytes import CARD, WEIGHT, framed, model_bytes, stored

ROOT = Path(__file__).resolve().parents[1]


def refused(path: Path) -> ModelFileError:
    """Refused by reading the card and by loading, with a sentence and a way out."""
    with pytest.raises(ModelFileError) as error:
        read_card(path)
    with pytest.raises(ModelFileError):
        load_model(path, "ntm")
    assert list_models((path.parent,)) == []
    assert path.name in error.value.message
    assert error.value.message.endswith(".")
    assert error.value.hint.endswith(".")
    return error.value


def test_a_missing_file(tmp_path: Path):
    assert "no model file" in str(refused(tmp_path / "none.safetensors"))


def test_a_folder(tmp_path: Path):
    path = tmp_path / "folder.safetensors"
    path.mkdir()
    refused(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_named_pipe_is_not_waited_for(tmp_path: Path):
    path = tmp_path / "pipe.safetensors"
    os.mkfifo(path)
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from model_runtime.model_files.weights import list_models\n"
        "print(list_models((Path(sys.argv[1]),)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=20,
        check=True,
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("kept", [0, 1, 7, 8, 9, 100, -1, -8])
def test_a_truncated_file(tmp_path: Path, kept: int):
    refused(stored(tmp_path, model_bytes()[:kept]))


def test_a_truncated_file_says_so(tmp_path: Path):
    assert "truncated" in str(refused(stored(tmp_path, model_bytes()[:-1])))


def test_a_file_with_something_appended(tmp_path: Path):
    refused(stored(tmp_path, model_bytes() + b"x"))


def test_a_newer_version_says_so(tmp_path: Path):
    card = CARD | {"version": FORMAT_VERSION + 1, "name": ["fields", "may", "change"]}
    error = refused(stored(tmp_path, model_bytes(card)))
    assert f"version {FORMAT_VERSION + 1}" in error.message
    assert "Update" in error.hint


def nested(depth: int) -> bytes:
    return b"[" * depth + b"]" * depth


HOSTILE = {
    "empty": b"",
    "noise": bytes(range(256)) * 50,
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(200),
    "a pickle": b"\x80\x04\x95\x10\x00\x00\x00\x00\x00\x00\x00cos\nsystem\n",
    "a header of 2^63 bytes": struct.pack("<Q", 1 << 63) + b"{}",
    "a header longer than the file": struct.pack("<Q", 1000) + b"{}" + bytes(10),
    "a header of nothing": struct.pack("<Q", 0) + bytes(8),
    "a huge header": framed(b'{"a": "' + b"x" * (2 << 20) + b'"}'),
    "no JSON": framed(b"{'a': 1}"),
    "no text": framed(b'{"\xff\xfe": 1}'),
    "a list": framed(b"[1, 2, 3]"),
    "deeply nested": framed(nested(100_000)),
    "no metadata": framed(json.dumps(WEIGHT).encode(), bytes(8)),
    "metadata that is a text": framed(b'{"__metadata__": "card"}'),
    "metadata that is null": framed(b'{"__metadata__": null}'),
    "a card that is no JSON": framed(b'{"__metadata__": {"card": "moss"}}'),
    "a card that is a number": framed(b'{"__metadata__": {"card": 1}}'),
    "a card that is nested": framed(
        json.dumps({"__metadata__": {"card": nested(100_000).decode()}, **WEIGHT}).encode(),
        bytes(8),
    ),
    "no tensors": model_bytes(tensors={}, data=b""),
    "tensors that are numbers": model_bytes(tensors={"weight": 3}),
    "offsets that are text": model_bytes(tensors={"weight": {"data_offsets": "0x"}}),
    "offsets without an end": model_bytes(tensors={"weight": {"data_offsets": [0]}}),
    "an endless offset": model_bytes(tensors={"weight": {"data_offsets": [0, float("inf")]}}),
    "an offset before the start": model_bytes(tensors={"weight": {"data_offsets": [0, -8]}}),
}
CARDS = {
    "another format": {"format": "gguf"},
    "a format that is a list": {"format": ["tvbrdf-ntm"]},
    "a version that is a word": {"version": "one"},
    "an endless version": {"version": float("inf")},
    "a version that is no number": {"version": float("nan")},
    "version null": {"version": None},
    "frames that are a word": {"frames": "many"},
    "endless frames": {"frames": float("inf")},
    "frames null": {"frames": None},
    "a domain that is a list": {"domain": [1]},
    "trained null": {"trained": None},
    "no title": {"title": ""},
    "title null": {"title": None},
    "name null": {"name": None},
    "a name that is a number": {"name": 5},
    "a description that is a list": {"description": ["Grows"]},
    "source null": {"source": None},
    "no temporal model": {"temporal_model": None},
    "a lone surrogate": {"title": "Mo\ud800ss"},
    "escape codes": {"description": "\x1b[2JGrows"},
    "two lines": {"title": "Mo\nss"},
    "writing turned round": {"name": "mo\u202ess"},
    "an escape code deep inside": {"trained": {"data": [{"of": "\x9b2J"}]}},
    "an escape code for a field": {"x\x1b[2J": 1},
    "an endless title": {"title": "x" * 900_000},
    "an endless representation": {"representation": "\x1b[2J" + "x" * 900_000},
    "an endless text deep inside": {"trained": {"x": ["x" * 900_000]}},
    "an endless field": {"x" * 900_000: 1},
    "frames beyond any": {"frames": 2**31},
    "frames less than none": {"frames": -1},
    "frames that are true": {"frames": True},
    "frames in a list": {"frames": [2]},
    "a number that is none": {"domain": {"ranges": {"alpha": [float("nan"), 1]}}},
    "a number without end": {"trained": {"seed": 10**30}},
}


@pytest.mark.parametrize("content", HOSTILE.values(), ids=HOSTILE.keys())
def test_what_is_no_model(tmp_path: Path, content: bytes):
    refused(stored(tmp_path, content))


@pytest.mark.parametrize("change", CARDS.values(), ids=CARDS.keys())
def test_a_card_that_makes_no_sense(tmp_path: Path, change: dict[str, Any]):
    error = refused(stored(tmp_path, model_bytes(CARD | change)))
    assert len(str(error)) < 300
    assert str(error).isprintable()


@pytest.mark.parametrize("field", ["name", "title", "temporal_model"])
def test_a_card_without_what_everybody_shows(tmp_path: Path, field: str):
    card = {name: value for name, value in CARD.items() if name != field}
    assert f"its {field} is missing" in refused(stored(tmp_path, model_bytes(card))).message


def test_a_number_too_large_for_any_float(tmp_path: Path):
    header = model_bytes(CARD | {"trained": {"seconds": 123456789}})[8:-8].decode()
    refused(stored(tmp_path, framed(header.replace("123456789", "1e999").encode(), bytes(8))))


@pytest.mark.skipif(os.name == "nt", reason="names are plainer there")
def test_a_file_name_that_cannot_be_shown(tmp_path: Path):
    for name in ("\x1b[2Jmoss.safetensors", os.fsdecode(b"mo\xe9ss.safetensors")):
        with pytest.raises(ModelFileError) as error:
            read_card(stored(tmp_path, b"rubbish", name))
        assert str(error.value).isprintable()
    for path in (tmp_path / ("x" * 300 + ".safetensors"), tmp_path / ("x" * 900_000)):
        with pytest.raises(ModelFileError) as error:
            read_card(path)
        assert len(str(error.value)) < 600


@pytest.mark.parametrize(
    "tensors",
    [
        {"weight": {"dtype": "F32", "shape": [3], "data_offsets": [0, 8]}},
        {"weight": {"dtype": "X99", "shape": [2], "data_offsets": [0, 8]}},
        {"weight": {"dtype": "F32", "shape": [2], "data_offsets": [4, 8]}},
        {**WEIGHT, "other": {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}},
        {"weight": {"dtype": "F32", "shape": [-2], "data_offsets": [0, 8]}},
        {"weight": {"dtype": "F32", "shape": [2**62, 2], "data_offsets": [0, 8]}},
        {"weight": {"dtype": "I64", "shape": [1], "data_offsets": [0, 8]}},
        {"weight": {"dtype": "BF16", "shape": [4], "data_offsets": [0, 8]}},
        {"weight": {"dtype": "F8_E4M3", "shape": [8], "data_offsets": [0, 8]}},
    ],
    ids=["size", "type", "gap", "overlap", "negative", "overflow", "integers", "bfloat", "float8"],
)
def test_damaged_tensors_are_refused_when_loaded(tmp_path: Path, tensors: dict[str, Any]):
    path = stored(tmp_path, model_bytes(tensors=tensors))
    with pytest.raises(ModelFileError) as error:
        load_model(path, "ntm")
    assert path.name in error.value.message


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_no_numbers(tmp_path: Path, value: float):
    path = tmp_path / "moss.safetensors"
    save_model(path, {"weight": torch.tensor([1.0, value])}, CARD, kind="ntm")
    with pytest.raises(ModelFileError, match="not finite"):
        load_model(path, "ntm")


def test_weights_that_no_training_makes(tmp_path: Path):
    path = tmp_path / "moss.safetensors"
    for value in (3e38, -2e4):
        save_model(path, {"weight": torch.tensor([1.0, value])}, CARD, kind="ntm")
        with pytest.raises(ModelFileError, match="no training makes"):
            load_model(path, "ntm")


def test_an_encoder_is_no_ntm(tmp_path: Path):
    path = stored(tmp_path, model_bytes(CARD | {"format": "tvbrdf-encoder"}))
    with pytest.raises(ModelFileError, match="holds an encoder, not an ntm"):
        load_model(path, "ntm")
    assert list_models((tmp_path,)) == []
