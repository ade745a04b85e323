"""Where cars hand in their diffs over a WebSocket: one connection for a whole drive."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from fastapi import APIRouter, Depends, WebSocket, WebSocketDisconnect

from autowaze.cloud.api.diff_desk import DiffDesk
from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.problems import ProblemError
from autowaze.cloud.store.tokens import Scope
from autowaze.world.wire import MAX_MESSAGE_BYTES

IDLE_S = 300.0
"""A car sends a diff every few seconds; one that is silent for so long connects again when it has one."""
TOO_LARGE, NO_DIFF, IDLE, NOT_ADMITTED = 1009, 1003, 1001, 1008


def ingest_socket_routes(desk: DiffDesk, guard: Guard) -> APIRouter:
    """`/v1/diffs/ws`: each binary message is a diff, each text message the acknowledgement of the diff before it."""
    router = APIRouter()
    admits = guard.admits(Scope.DIFFS)

    @router.websocket("/v1/diffs/ws")
    async def hand_in(socket: WebSocket, bearer: str = Depends(admits)) -> None:
        await socket.accept()
        with suppress(WebSocketDisconnect):
            while True:
                try:
                    async with asyncio.timeout(IDLE_S):
                        message = await socket.receive()
                except TimeoutError:
                    await socket.close(IDLE)
                    return
                if message["type"] == "websocket.disconnect":
                    return
                diff = message.get("bytes")
                if diff is None or len(diff) > MAX_MESSAGE_BYTES:
                    await socket.close(NO_DIFF if diff is None else TOO_LARGE)
                    return
                try:
                    await admits(socket)  # the token may have been revoked since
                except ProblemError as error:
                    await socket.close(NOT_ADMITTED, error.detail)
                    return
                await socket.send_bytes((await desk.hand_in(diff, bearer)).encode())

    return router
