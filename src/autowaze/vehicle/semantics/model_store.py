"""Published segmentation models: which there are, fetching them, and where they lie on this machine."""

from __future__ import annotations

import hashlib
import os
import urllib.error
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.world.errors import ModelError

_CHUNK = 1 << 18
_TIMEOUT_S = 30.0

BUNDLED = "bundled"
"""Name of the model that comes with the package."""

Progress = Callable[[int, int], None]
"""Called with the bytes that are here and the bytes there will be."""


class PublishedModel(BaseModel):
    """A model that somebody publishes under a licence of its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=r"^[a-z0-9-]+$")
    summary: str
    licence: str
    url: str
    size_bytes: int
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    config: ModelConfig


@dataclass(frozen=True)
class StoredModel:
    """A published model and where it lies, `path` being None until it is pulled."""

    model: PublishedModel
    path: Path | None


@cache
def published_models() -> tuple[PublishedModel, ...]:
    """The models that Autowaze knows where to get."""
    text = (files("autowaze.vehicle.semantics") / "published_models.json").read_bytes()
    return tuple(TypeAdapter(list[PublishedModel]).validate_json(text))


def bundled_model() -> Path:
    """The model that comes with the package (docs/model-card.md)."""
    return Path(str(files("autowaze.vehicle.semantics") / "bundled" / "street-cells.onnx"))


def default_folder() -> Path:
    """Where models lie: AUTOWAZE_MODELS, else autowaze/models in the user's cache folder."""
    stated = os.environ.get("AUTOWAZE_MODELS")
    cache_folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(stated) if stated else cache_folder / "autowaze" / "models"


class ModelStore:
    """The models of one folder.

    A model is one file NAME.onnx with its NAME.json beside it, so that its path works wherever a path is asked for.
    """

    def __init__(self, folder: Path | None = None, models: tuple[PublishedModel, ...] | None = None) -> None:
        self.folder = folder if folder is not None else default_folder()
        self._models = {m.name: m for m in (models if models is not None else published_models())}

    def models(self) -> list[StoredModel]:
        """All published models, by name."""
        return [
            StoredModel(m, self._file(m) if self._file(m).is_file() else None) for _, m in sorted(self._models.items())
        ]

    def path(self, name: str) -> Path:
        """Path of a pulled model.

        Raises:
            ModelError: there is no such model, or it has not been pulled.
        """
        path = self._file(self._published(name))
        if not path.is_file():
            raise ModelError(f"model {name!r} is not on this machine; run: autowaze models pull {name}")
        return path

    def pull(self, name: str, progress: Progress = lambda done, total: None) -> Path:
        """Fetch a model, continuing what an earlier attempt left; returns its path.

        Raises:
            ModelError: there is no such model, it cannot be reached, or what came is not what was published.
        """
        model = self._published(name)
        path = self._file(model)
        if not path.is_file():
            partial = path.with_suffix(".part")
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                _fetch(model, partial, progress)
                _verify(model, partial)
                path.with_suffix(".json").write_text(model.config.model_dump_json(exclude_defaults=True))
                partial.replace(path)
            except OSError as error:
                raise ModelError(
                    f"{model.url}: cannot be fetched: {getattr(error, 'reason', error)}; run the command again to "
                    f"continue, or copy the file to {path} by hand"
                ) from error
        return path

    def _published(self, name: str) -> PublishedModel:
        if name not in self._models:
            known = ", ".join(sorted(self._models))
            raise ModelError(f"no model is called {name!r}; there are: {known}; or give the path of a model file")
        return self._models[name]

    def _file(self, model: PublishedModel) -> Path:
        return self.folder / f"{model.name}.onnx"


def _fetch(model: PublishedModel, partial: Path, progress: Progress) -> None:
    """Complete the partial file."""
    done = partial.stat().st_size if partial.is_file() else 0
    if done >= model.size_bytes:
        return
    request = urllib.request.Request(model.url, headers={"Range": f"bytes={done}-"} if done else {})
    with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as response:
        resumed = done > 0 and response.status == 206
        done = done if resumed else 0
        with partial.open("ab" if resumed else "wb") as out:
            while (chunk := response.read(_CHUNK)) and done < model.size_bytes:
                out.write(chunk)
                done += len(chunk)
                progress(done, model.size_bytes)
    if done < model.size_bytes:
        raise ConnectionError(f"the connection ended after {done} of {model.size_bytes} bytes")


def _verify(model: PublishedModel, partial: Path) -> None:
    """Drop the file unless it is the one that was published."""
    with partial.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    if sha256 != model.sha256:
        size = partial.stat().st_size
        partial.unlink()
        raise ModelError(
            f"{model.url}: what came ({size} bytes, sha256 {sha256[:12]}…) is not the published file "
            f"({model.size_bytes} bytes, sha256 {model.sha256[:12]}…) and was deleted"
        )
