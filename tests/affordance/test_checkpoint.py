"""Laws of a model's file."""
# ruff: noqa: E402 - what needs torch is imported once it is known to be there

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("safetensors", reason="safetensors is not installed")

from safetensors import safe_open
from safetensors.torch import save as encoded

from affordance import checkpoint
from affordance.networks import Model
from affordance.settings import settings_of
from robots.errors import BadInput
from tests.affordance.clouds import clouds


@pytest.fixture(scope="module")
def model() -> Model:
    torch.manual_seed(0)
    return Model(msgspec.structs.replace(settings_of("test", "sxy"), head="flow")).eval()


@pytest.fixture(scope="module")
def written(model: Model, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("model") / "model.safetensors"
    return checkpoint.save(path, model, "hash", 1234, {"adam.step": torch.tensor(7)}).read_bytes()


def file_of(folder: Path, data: bytes) -> Path:
    path = folder / "model.safetensors"
    path.write_bytes(data)
    return path


def parts(data: bytes) -> tuple[dict[str, object], bytes]:
    """The JSON at the beginning of a safetensors file, and the tensors after it."""
    size = int.from_bytes(data[:8], "little")
    return json.loads(data[8 : 8 + size]), data[8 + size :]


def with_header(data: bytes, change: Callable[[dict[str, object]], None]) -> bytes:
    """The file with another JSON entry of ours."""
    head, tensors = parts(data)
    entry = json.loads(head["__metadata__"][checkpoint.ENTRY])
    change(entry)
    head["__metadata__"][checkpoint.ENTRY] = json.dumps(entry)
    text = json.dumps(head).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + tensors


def test_a_model_comes_back_as_it_was(model: Model, written: bytes, tmp_path: Path) -> None:
    found = checkpoint.load(file_of(tmp_path, written))
    assert (found.text_backend, found.step, found.model.settings) == ("hash", 1234, model.settings)
    assert found.versions["torch"] == torch.__version__
    assert {name: int(tensor) for name, tensor in found.extra.items()} == {"adam.step": 7}
    with torch.no_grad():
        assert torch.equal(found.model.encoder(clouds(1, 256)).points, model.encoder(clouds(1, 256)).points)
    assert not found.model.training


def test_half_the_size_is_nearly_the_same_model(model: Model, written: bytes, tmp_path: Path) -> None:
    path = checkpoint.save(tmp_path / "half", model, "hash", 1234, half=True)
    assert path.stat().st_size < 0.52 * len(written)
    found = checkpoint.load(path).model
    assert all(weight.dtype == torch.float32 for weight in found.parameters())
    with torch.no_grad():
        there, here = (one.encoder(clouds(1, 256)).points for one in (found, model))
    assert float((there - here).abs().max()) < 0.02 * float(here.abs().max())


def test_the_same_model_gives_the_same_bytes(model: Model, written: bytes, tmp_path: Path) -> None:
    again = checkpoint.save(tmp_path / "again", model, "hash", 1234, {"adam.step": torch.tensor(7)})
    assert again.read_bytes() == written


def test_a_failed_write_leaves_the_old_file(
    model: Model, written: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = file_of(tmp_path, written)

    def refuse(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OSError, match="disk full"):
        checkpoint.save(path, model, "hash", 2)
    assert path.read_bytes() == written
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("share", [0.0, 0.0000005, 0.001, 0.5, 0.999])
def test_a_file_that_is_cut_off_is_refused(written: bytes, tmp_path: Path, share: float) -> None:
    with pytest.raises(BadInput, match="cannot be read as a model"):
        checkpoint.load(file_of(tmp_path, written[: int(share * len(written))]))


@pytest.mark.parametrize("place", [0.3, 0.7, 0.999])
def test_a_changed_weight_is_noticed(written: bytes, tmp_path: Path, place: float) -> None:
    data = bytearray(written)
    data[int(place * len(data))] ^= 1
    with pytest.raises(BadInput, match="is damaged"):
        checkpoint.load(file_of(tmp_path, bytes(data)))


def test_a_changed_header_is_noticed(written: bytes, tmp_path: Path) -> None:
    data = with_header(written, lambda entry: entry.update(text_backend="clip"))
    with pytest.raises(BadInput, match="is damaged"):
        checkpoint.load(file_of(tmp_path, data))
    data = with_header(written, lambda entry: entry.update(surprise=1))
    with pytest.raises(BadInput, match="unknown field `surprise`"):
        checkpoint.load(file_of(tmp_path, data))


def test_a_file_older_than_a_setting_has_its_default(model: Model, tmp_path: Path) -> None:
    """The shipped weights must outlive the next setting; their digest is of what was written then."""
    path = checkpoint.save(tmp_path / "model.safetensors", model, "hash", 5)
    with safe_open(path, framework="pt") as file:
        text = file.metadata()[checkpoint.ENTRY]
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
    entry = json.loads(text)
    del entry["settings"]["training"]["bf16"]
    digest = entry["digest"]
    older = json.dumps(entry, separators=(",", ":"))
    unsigned = older.replace(digest, "").encode()
    older = older.replace(digest, checkpoint._digest(unsigned, tensors))
    path.write_bytes(encoded(tensors, {checkpoint.ENTRY: older}))
    assert checkpoint.load(path).model.settings == model.settings


def test_another_version_is_named(written: bytes, tmp_path: Path) -> None:
    data = with_header(written, lambda entry: entry.update(version=2))
    with pytest.raises(BadInput, match="is a bipremanip-model of version 2; version 1 is read"):
        checkpoint.load(file_of(tmp_path, data))


def test_files_of_other_kinds_are_refused(tmp_path: Path) -> None:
    foreign = encoded({"weight": torch.zeros(3)})
    with pytest.raises(BadInput, match="is not a model of bipremanip"):
        checkpoint.load(file_of(tmp_path, foreign))
    for data in (b"not a model at all, but text", pickle.dumps({"weight": [1.0]}), b"\x89PNG" + bytes(200)):
        with pytest.raises(BadInput, match="cannot be read as a model"):
            checkpoint.load(file_of(tmp_path, data))
    with pytest.raises(BadInput, match="There is no model"):
        checkpoint.load(tmp_path / "nowhere")
    with pytest.raises(BadInput, match="There is no model"):
        checkpoint.load(tmp_path)


def test_weights_that_do_not_fit_their_settings_are_refused(model: Model, tmp_path: Path) -> None:
    other = Model(settings_of("test"))
    other.settings = model.settings
    with pytest.raises(BadInput, match=r"does not fit its own settings: \d+ tensors differ, the first is critics"):
        checkpoint.load(checkpoint.save(tmp_path / "other", other, "hash", 0))


def test_weights_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    broken = Model(settings_of("test"))
    with torch.no_grad():
        broken.goal.scorer[0].bias[3] = torch.nan
    with pytest.raises(BadInput, match=r"goal\.scorer\.0\.bias has values that are not finite"):
        checkpoint.load(checkpoint.save(tmp_path / "broken", broken, "hash", 0))
