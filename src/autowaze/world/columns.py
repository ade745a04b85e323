"""Struct-of-arrays dataclasses: one row per feature, one numpy array per property."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import AutowazeError


class Columns:
    """Mixin of a dataclass whose fields are arrays of one common length.

    `selection = features[features.depth < 20]` filters by mask, index array or slice; `A.concatenate([a, b])` joins.
    """

    def __post_init__(self) -> None:
        lengths = {name: len(getattr(self, name)) for name in names_of(type(self))}
        if len(set(lengths.values())) > 1:
            raise AutowazeError(f"{type(self).__name__}: columns differ in length: {lengths}")

    def __len__(self) -> int:
        return len(getattr(self, names_of(type(self))[0]))

    def __getitem__(self, rows: NDArray[Any] | slice) -> Self:
        return self._of({name: column[rows] for name, column in self.__dict__.items()})

    @classmethod
    def concatenate(cls, parts: list[Self]) -> Self:
        """All rows of the parts, in order; an empty list is an error (build an `empty()` instead)."""
        columns = [part.__dict__ for part in parts]
        return cls._of({name: np.concatenate([own[name] for own in columns]) for name in names_of(cls)})

    @classmethod
    def _of(cls, columns: dict[str, NDArray[Any]]) -> Self:
        """Columns known to be of one length: services do this a hundred times per diff, so nothing is checked."""
        rows = object.__new__(cls)
        rows.__dict__.update(columns)
        return rows


_NAMES: dict[type, tuple[str, ...]] = {}


def names_of(kind: type[Columns]) -> tuple[str, ...]:
    """Names of the columns of a class, in order."""
    names = _NAMES.get(kind)
    if names is None:
        names = _NAMES[kind] = tuple(f.name for f in fields(kind))  # type: ignore[arg-type]
    return names
