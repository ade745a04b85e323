"""The audit log for operators: who did, or was refused, what."""

from __future__ import annotations

import asyncio
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends, Query
from pydantic import BaseModel

from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.problems import problems
from autowaze.cloud.store import Store
from autowaze.cloud.store.tokens import Scope

MOST_ENTRIES = 1000


class AuditItem(BaseModel):
    """One entry.

    Attributes:
        number: counts entries.
        at: seconds since the epoch (UTC).
        actor: name of the token; empty for nobody known.
        action: what was done or refused.
        detail: for a person.
    """

    number: int
    at: float
    actor: str
    action: str
    detail: str


class AuditPage(BaseModel):
    """Entries, oldest first; `next` is the `after` of the next page, null where there is none yet."""

    entries: list[AuditItem]
    next: int | None


def audit_routes(store: Store, guard: Guard) -> APIRouter:
    """`/audit`."""
    router = APIRouter(tags=["operation"], dependencies=[Depends(guard.admits(Scope.OPERATOR))])

    @router.get("/audit", responses=problems(HTTPStatus.BAD_REQUEST, HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN))
    async def audit(
        after: Annotated[int, Query(ge=0, lt=1 << 62)] = 0, limit: Annotated[int, Query(ge=1, le=MOST_ENTRIES)] = 100
    ) -> AuditPage:
        """Entries after a number."""
        found = await asyncio.to_thread(store.audit_entries, after, limit)
        items = [AuditItem(number=e.number, at=e.at, actor=e.actor, action=e.action, detail=e.detail) for e in found]
        return AuditPage(entries=items, next=items[-1].number if len(items) == limit else None)

    return router
