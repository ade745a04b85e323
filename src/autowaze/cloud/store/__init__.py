"""Where accepted diffs and the state of the spots outlive the process."""

from autowaze.cloud.store.sqlite import SqliteStore
from autowaze.cloud.store.store import Accepted, Store, StoreError

__all__ = ["Accepted", "SqliteStore", "Store", "StoreError"]
