"""The schema of a store, as numbered SQL files that are run once each, in order."""

from __future__ import annotations

from importlib.resources import files

from autowaze.cloud.store.database import StoreError


def pending(dialect: str, version: int, name: str) -> list[tuple[int, str]]:
    """Number and text of each migration that a database of a version still needs.

    Args:
        dialect: `sqlite` or `postgres`.
        version: number of the last migration that was run; 0 for an empty database.
        name: of the database, for the error.

    Raises:
        StoreError: a newer program made the database.
    """
    folder = files(__package__) / "migrations" / dialect
    known = sorted((int(file.name.split("_")[0]), file) for file in folder.iterdir() if file.name.endswith(".sql"))
    if version > known[-1][0]:
        raise StoreError(
            f"{name}: store of version {version}, this program knows {known[-1][0]}: use the newer program"
        )
    return [(number, file.read_text(encoding="utf-8")) for number, file in known if number > version]
