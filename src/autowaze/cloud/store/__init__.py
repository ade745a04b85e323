"""Where accepted diffs and the state of the spots outlive the process."""

from autowaze.cloud.store.address import open_store
from autowaze.cloud.store.sqlite import SqliteStore
from autowaze.cloud.store.store import Accepted, AuditEntry, SpotChange, Store, StoreError
from autowaze.cloud.store.tokens import open_tokens

__all__ = [
    "Accepted",
    "AuditEntry",
    "SpotChange",
    "SqliteStore",
    "Store",
    "StoreError",
    "open_store",
    "open_tokens",
]
