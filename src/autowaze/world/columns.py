"""Struct-of-arrays dataclasses: one row per feature, one numpy array per property."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from autowaze.world.errors import AutowazeError


class Columns:
    """Mixin of a dataclass whose fields are arrays of one common length.

    `selection = features[features.depth < 20]` filters by mask, index array or slice; `A.concatenate([a, b])` joins.
    """

    def __post_init__(self) -> None:
        lengths = {f.name: len(getattr(self, f.name)) for f in fields(self)}  # type: ignore[arg-type]
        if len(set(lengths.values())) > 1:
            raise AutowazeError(f"{type(self).__name__}: columns differ in length: {lengths}")

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))  # type: ignore[arg-type]

    def __getitem__(self, rows: NDArray[Any] | slice) -> Self:
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)})  # type: ignore[type-var,arg-type]

    @classmethod
    def concatenate(cls, parts: list[Self]) -> Self:
        """All rows of the parts, in order; an empty list is an error (build an `empty()` instead)."""
        names = [f.name for f in fields(cls)]  # type: ignore[arg-type]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
