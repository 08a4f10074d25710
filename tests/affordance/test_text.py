"""Laws of the text encoders."""

from __future__ import annotations

import importlib.util
import json
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from affordance.text import PARAPHRASES, TEXT, HashText, paraphrases, text_encoder
from robots.errors import BadInput, MissingDependency, UnknownName
from worlds.tasks import TASK_TYPES, TASKS

INSTRUCTIONS = sorted({task.instruction for task in TASKS.values()})


def test_vectors_have_length_one_and_do_not_depend_on_company() -> None:
    encoder = HashText()
    found = encoder.encode(INSTRUCTIONS)
    assert found.shape == (len(INSTRUCTIONS), TEXT)
    assert found.dtype == np.float32
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-6)
    assert np.array_equal(encoder.encode(INSTRUCTIONS[3:4])[0], found[3])
    assert encoder.encode([]).shape == (0, TEXT)


def test_no_two_instructions_look_alike() -> None:
    found = HashText().encode(INSTRUCTIONS)
    for a, b in combinations(range(len(INSTRUCTIONS)), 2):
        assert found[a] @ found[b] < 0.95, (INSTRUCTIONS[a], INSTRUCTIONS[b])


def test_shared_words_and_letters_bring_texts_near() -> None:
    pen, pens, plate = HashText().encode(["pull the cap off the pen", "pulling the caps off pens", "tilt a dish"])
    assert pen @ pens > 0.3 > pen @ plate + 0.1


def test_case_and_punctuation_do_not_matter() -> None:
    plain, loud = HashText().encode(["pick up the bowl", "Pick up, the BOWL!"])
    assert np.array_equal(plain, loud)


def test_the_hash_is_the_same_in_every_process() -> None:
    vector = HashText().encode(["a"])[0]
    places = np.flatnonzero(vector)
    assert {place: round(float(vector[place]), 4) for place in places.tolist()} == {67: -0.4472, 194: 0.8944}


@pytest.mark.parametrize("text", ["", " ?! "])
def test_a_text_without_words_is_refused(text: str) -> None:
    with pytest.raises(BadInput, match="has no words"):
        HashText().encode(["pick up the bowl", text])


def test_every_task_can_be_asked_for_in_eight_ways_two_of_them_held_out() -> None:
    assert set(PARAPHRASES) == set(TASK_TYPES)
    for task in TASKS.values():
        training, held_out = paraphrases(task)
        assert (len(training), len(held_out)) == (6, 2)
        assert training[0] == task.instruction
        assert len({*training, *held_out}) == 8
        assert not any("{" in way for way in (*training, *held_out))
    assert "get me the remote control" in paraphrases(TASKS["Remote"])[1]


def test_an_unknown_encoder_names_those_there_are() -> None:
    with pytest.raises(UnknownName, match=r'No text encoder "has"\. Did you mean "hash"\?'):
        text_encoder("has")
    assert text_encoder("hash").name == "hash"


def test_clip_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(BadInput, match="needs the folder of its weights"):
        text_encoder("clip")
    with pytest.raises(BadInput, match=r"There is no folder .*nowhere"):
        text_encoder("clip", tmp_path / "nowhere")
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(MissingDependency, match=r'pip install "bipremanip\[clip\]"'):
        text_encoder("clip", tmp_path)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
@pytest.mark.skipif(importlib.util.find_spec("transformers") is None, reason="transformers is not installed")
def test_clip_reads_a_local_model_and_refuses_what_is_none(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot be read as a CLIP model"):
        text_encoder("clip", tmp_path)
    small_clip(tmp_path / "right", TEXT)
    found = text_encoder("clip", tmp_path / "right").encode(["pick up the bowl", "a bowl", "pick up the bowl"])
    assert found.shape == (3, TEXT)
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-5)
    assert np.allclose(found[0], found[2], atol=1e-5)
    assert found[0] @ found[1] < 0.999
    small_clip(tmp_path / "wrong", 64)
    with pytest.raises(BadInput, match="gives 64 numbers a text; 512 are needed"):
        text_encoder("clip", tmp_path / "wrong")


def small_clip(folder: Path, size: int) -> None:
    """Write a tiny CLIP text tower with random weights and a vocabulary of letters."""
    import torch
    from transformers import CLIPTextConfig, CLIPTextModelWithProjection

    torch.manual_seed(0)
    letters = "abcdefghijklmnopqrstuvwxyz"
    words = [*letters, *(letter + "</w>" for letter in letters), "<|startoftext|>", "<|endoftext|>"]
    config = CLIPTextConfig(
        vocab_size=len(words),
        hidden_size=32,
        intermediate_size=64,
        num_hidden_layers=1,
        num_attention_heads=2,
        projection_dim=size,
        bos_token_id=len(words) - 2,
        eos_token_id=len(words) - 1,
        pad_token_id=len(words) - 1,
    )
    CLIPTextModelWithProjection(config).save_pretrained(folder)
    (folder / "vocab.json").write_text(json.dumps({word: k for k, word in enumerate(words)}))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    special = {"bos_token": words[-2], "eos_token": words[-1], "pad_token": words[-1], "unk_token": words[-1]}
    (folder / "tokenizer_config.json").write_text(json.dumps({"tokenizer_class": "CLIPTokenizer", **special}))
