"""How is a model kept? As one safetensors file whose header says what it is; never as a pickle, which could run code.

The header holds the settings, the text encoder, package versions and the step of training as JSON, and a digest of all
of it and of every weight. A file that is damaged, cut off or of another kind is refused before anything is built.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
import torch
from msgspec import Struct
from torch import Tensor

from affordance.networks import Model
from affordance.settings import Settings
from affordance.text import Backend
from robots.cache import write_atomic
from robots.errors import BadInput, MissingDependency

FORMAT, VERSION = "bipremanip-model", 1

ENTRY = FORMAT
"""Key of the header under which the JSON stands."""

EXTRA = "extra."
"""Beginning of the names of tensors that are not weights of the model."""

PACKAGES = ("bipremanip", "torch", "numpy", "safetensors")


class Header(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a model's file says about it."""

    format: str
    version: int
    settings: Settings
    text_backend: Backend
    """Through which instructions must be given."""
    step: int
    """Of training."""
    versions: dict[str, str]
    """Packages it was written with."""
    digest: str
    """Of the rest of the header and of all tensors."""


class _Head(Struct):
    """What any version of the header has."""

    format: str
    version: int


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """A model and what must be known of it.

    Attributes:
        model: The networks, on the CPU.
        text_backend: Name of the text encoder it was trained with.
        step: Of training.
        versions: Packages it was written with.
        extra: Further tensors by name, for example an optimiser's, from which training goes on.
    """

    model: Model
    text_backend: Backend
    step: int
    versions: Mapping[str, str]
    extra: Mapping[str, Tensor] = field(default_factory=dict)


def save(
    path: Path,
    model: Model,
    text_backend: Backend,
    step: int,
    extra: Mapping[str, Tensor] | None = None,
    *,
    half: bool = False,
) -> Path:
    """Write a model; the file is either absent, old or complete.

    Args:
        path: Where.
        model: The networks.
        text_backend: Name of the text encoder it is trained with.
        step: Of training.
        extra: Further tensors to keep with it.
        half: Whether numbers are kept in 16 bits, which is enough to ask the networks and half the size.
    """
    tensors = {**model.state_dict(), **{EXTRA + name: tensor for name, tensor in (extra or {}).items()}}
    plain = {name: tensor.detach().cpu().contiguous().clone() for name, tensor in tensors.items()}
    if half:
        plain = {name: tensor.half() if tensor.is_floating_point() else tensor for name, tensor in plain.items()}
    header = Header(
        format=FORMAT,
        version=VERSION,
        settings=model.settings,
        text_backend=text_backend,
        step=step,
        versions=_versions(),
        digest="",
    )
    whole = msgspec.structs.replace(header, digest=_digest(msgspec.json.encode(header), plain))
    _require_safetensors()
    from safetensors.torch import save as encoded

    return write_atomic(path, encoded(plain, {ENTRY: msgspec.json.encode(whole).decode()}))


def load(path: Path) -> Checkpoint:
    """Read a model.

    Raises:
        BadInput: The file is missing, damaged, cut off, or not a model of this version.
    """
    header, tensors = _read(path)
    extra = {name.removeprefix(EXTRA): tensors.pop(name) for name in list(tensors) if name.startswith(EXTRA)}
    tensors = {name: tensor.float() if tensor.dtype == torch.float16 else tensor for name, tensor in tensors.items()}
    model = Model(header.settings)
    _require_same_shapes(path, model.state_dict(), tensors)
    model.load_state_dict(tensors)
    return Checkpoint(model.eval(), header.text_backend, header.step, header.versions, extra)


def _read(path: Path) -> tuple[Header, dict[str, Tensor]]:
    _require_safetensors()
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        raise BadInput(f"There is no model {path}.")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            header = _header(path, metadata)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
    except (SafetensorError, OSError) as error:
        raise BadInput(f"{path} cannot be read as a model: {error}.") from error
    # What was written counts, not what it is read as: a setting that is newer than the file has its default.
    if _digest(metadata[ENTRY].replace(header.digest, "").encode(), tensors) != header.digest:
        raise BadInput(f"The model {path} is damaged: its contents do not match the digest in its header.")
    broken = next((name for name, tensor in tensors.items() if not bool(torch.isfinite(tensor).all())), None)
    if broken is not None:
        raise BadInput(f"The model {path} is of no use: {broken} has values that are not finite.")
    return header, tensors


def _header(path: Path, metadata: Mapping[str, str]) -> Header:
    if ENTRY not in metadata:
        raise BadInput(f"{path} holds tensors but is not a model of bipremanip: its header does not name it.")
    try:
        head = msgspec.json.decode(metadata[ENTRY], type=_Head)
        if (head.format, head.version) != (FORMAT, VERSION):
            raise BadInput(f"{path} is a {head.format} of version {head.version}; version {VERSION} is read.")
        return msgspec.json.decode(metadata[ENTRY], type=Header)
    except msgspec.DecodeError as error:
        raise BadInput(f"The header of the model {path} cannot be read: {error}.") from error


def _require_same_shapes(path: Path, wanted: Mapping[str, Tensor], found: Mapping[str, Tensor]) -> None:
    kinds = {name: (tuple(tensor.shape), tensor.dtype) for name, tensor in wanted.items()}
    given = {name: (tuple(tensor.shape), tensor.dtype) for name, tensor in found.items()}
    wrong = sorted(name for name in kinds.keys() | given.keys() if kinds.get(name) != given.get(name))
    if wrong:
        raise BadInput(
            f"The model {path} does not fit its own settings: {len(wrong)} tensors differ, the first is {wrong[0]}. "
            f"It was written by another version of the networks."
        )


def _digest(header: bytes, tensors: Mapping[str, Tensor]) -> str:
    """Of a header whose digest is empty, and of tensors."""
    digest = hashlib.sha256(header)
    for name, tensor in sorted(tensors.items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def _versions() -> dict[str, str]:
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def _require_safetensors() -> None:
    try:
        import safetensors.torch  # noqa: F401
    except ImportError as error:
        raise MissingDependency("safetensors", "learn", "A model file") from error
