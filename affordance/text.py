"""What does an instruction mean to a network? A unit vector of 512 numbers, from words alone or from CLIP.

CLIP's weights (Radford et al., "Learning Transferable Visual Models From Natural Language Supervision", ICML 2021) are
not ours to ship and nothing is downloaded: they are read from a folder that the user names. Without one, words and
their letters are hashed, which tells apart every instruction of the benchmark and brings near those that share words.
"""

from __future__ import annotations

import hashlib
import importlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Protocol, get_args

import numpy as np

from robots.errors import BadInput, MissingDependency, UnknownName
from worlds.tasks import Task, TaskType

TEXT = 512
"""Numbers of an embedded text: CLIP ViT-B/32's."""

GRAM = 3
"""Letters that are hashed together."""

GRAM_WEIGHT = 0.5
"""Weight of such letters against that of a whole word."""

Backend = Literal["hash", "clip"]

Vectors = np.ndarray[Any, np.dtype[np.float32]]

PARAPHRASES: dict[TaskType, tuple[str, ...]] = {
    "articulated": (
        "{instruction}",
        "please {instruction}",
        "use both arms to {instruction}",
        "hold the {object} with one hand and {instruction} with the other",
        "I would like you to {instruction}",
        "lift the {object}, turn it and {instruction}",
        "could you {instruction} for me",
        "take the {object} and {instruction}",
    ),
    "edge_push": (
        "{instruction}",
        "push the {object} to the edge and pick it up",
        "grasp the {object} at the edge of the table",
        "lift the {object} off the table",
        "slide the {object} over the edge, then grab it",
        "take the {object} from the table",
        "get me the {object}",
        "raise the {object} after pushing it to the rim of the table",
    ),
    "plate_lift": (
        "{instruction}",
        "press the {object} down on one side and lift it",
        "tilt the {object} and grasp its raised rim",
        "lift the {object} off the table",
        "take the {object} from the table",
        "use both arms to pick up the {object}",
        "get me the {object}",
        "raise the {object} by its rim",
    ),
    "handover": (
        "{instruction}",
        "give me the {object}",
        "pass the {object} to me",
        "bring me the {object}",
        "hold the {object} out so that I can take it",
        "present the {object} to the person",
        "let me have the {object}",
        "offer the {object} to my hand",
    ),
}
"""Ways to ask for what a task asks; training draws from all but the last ``HELD_OUT``, which test what was learned."""

HELD_OUT = 2

SPOKEN = {"Pen-Button": "pen", "Pen-Cap": "pen", "Remote": "remote control", "USB": "USB stick"}
"""What objects are called where that is not the name of their category."""


class TextEncoder(Protocol):
    """Anything that embeds instructions."""

    @property
    def name(self) -> Backend:
        """What a checkpoint records; a model must be asked through the encoder it was trained with."""

    def encode(self, texts: Sequence[str]) -> Vectors:
        """``(B, 512)`` vectors of length one."""


class HashText:
    """Words and the letters in them, each added to a place with a sign, both decided by a hash."""

    name: Backend = "hash"

    def encode(self, texts: Sequence[str]) -> Vectors:
        """``(B, 512)`` vectors of length one; ``BadInput`` for a text without a letter or digit."""
        return np.array([_hashed(text) for text in texts], dtype=np.float32).reshape(-1, TEXT)


class ClipText:
    """The text tower of a CLIP model, read from a local folder in the layout of ``transformers``."""

    name: Backend = "clip"

    def __init__(self, folder: Path) -> None:
        """Load it.

        Raises:
            BadInput: The folder is missing or holds no CLIP model whose text vectors have 512 numbers.
            MissingDependency: ``transformers`` is not installed.
        """
        if not folder.is_dir():
            raise BadInput(f"There is no folder {folder}. Name one with the weights and vocabulary of a CLIP model.")
        try:
            transformers: Any = importlib.import_module("transformers")
        except ImportError as error:
            raise MissingDependency("transformers", "clip", "CLIP text") from error
        try:
            self._tokenizer = transformers.CLIPTokenizer.from_pretrained(folder, local_files_only=True)
            self._model = transformers.CLIPTextModelWithProjection.from_pretrained(folder, local_files_only=True)
            self._model.eval()
        except (OSError, ValueError, RuntimeError, KeyError, TypeError) as error:
            raise BadInput(f"{folder} cannot be read as a CLIP model: {error}") from error
        found = self._model.config.projection_dim
        if found != TEXT:
            raise BadInput(f"The CLIP model in {folder} gives {found} numbers a text; {TEXT} are needed (ViT-B/32).")

    def encode(self, texts: Sequence[str]) -> Vectors:
        """``(B, 512)`` vectors of length one; ``BadInput`` for a text without a letter or digit."""
        import torch

        for text in texts:
            _words(text)
        if not texts:
            return np.zeros((0, TEXT), dtype=np.float32)
        tokens = self._tokenizer(list(texts), padding=True, truncation=True, return_tensors="pt")
        with torch.no_grad():
            found = self._model(**tokens).text_embeds
            vectors: Vectors = torch.nn.functional.normalize(found, dim=-1).numpy()
        return vectors


def text_encoder(backend: str, weights: Path | None = None) -> TextEncoder:
    """The encoder of that name.

    Args:
        backend: ``hash`` or ``clip``.
        weights: Folder of the CLIP model.

    Raises:
        UnknownName: There is no such encoder.
        BadInput: CLIP is wanted without usable weights.
        MissingDependency: CLIP is wanted without ``transformers``.
    """
    if backend not in get_args(Backend):
        raise UnknownName("text encoder", backend, get_args(Backend))
    if backend == "hash":
        return HashText()
    if weights is None:
        raise BadInput("The text encoder clip needs the folder of its weights; nothing is downloaded.")
    return ClipText(weights)


def paraphrases(task: Task) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Ways to ask for a task: those to learn from, the task's own instruction first, and those held out."""
    words = {"instruction": task.instruction, "object": named_object(task)}
    ways = tuple(way.format(**words) for way in PARAPHRASES[task.type])
    return ways[:-HELD_OUT], ways[-HELD_OUT:]


def named_object(task: Task) -> str:
    """What a user calls the object of a task, for example ``remote control``."""
    return SPOKEN.get(task.objects, task.objects.lower())


def _hashed(text: str) -> Vectors:
    vector = np.zeros(TEXT)
    for word in _words(text):
        _add(vector, f"word {word}", 1.0)
        padded = f" {word} "
        for start in range(len(padded) - GRAM + 1):
            _add(vector, f"gram {padded[start : start + GRAM]}", GRAM_WEIGHT)
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float32)


def _words(text: str) -> list[str]:
    """Lower-case words of a text; ``BadInput`` when there are none."""
    words = re.findall(r"\w+", text.lower())
    if not words:
        raise BadInput(f'The instruction "{text}" has no words.')
    return words


def _add(vector: Any, feature: str, weight: float) -> None:
    digest = int.from_bytes(hashlib.blake2b(feature.encode(), digest_size=8).digest(), "little")
    vector[(digest >> 1) % TEXT] += weight if digest & 1 else -weight
