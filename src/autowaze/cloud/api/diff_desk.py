"""Takes in diffs that come by other ways than a request of their own, and answers each with an acknowledgement."""

from __future__ import annotations

import hashlib
import logging
import time
from http import HTTPStatus

from starlette.exceptions import HTTPException

from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.intake import BusyError, Intake
from autowaze.cloud.api.meters import Meters
from autowaze.cloud.store import StoreError
from autowaze.world.acknowledgement import Acknowledgement, Verdict
from autowaze.world.errors import WireError

BUSY_WAIT_S = 2.0

_log = logging.getLogger(__name__)


class DiffDesk:
    """Hands diffs on to the intake by the same rules as `POST /v1/diffs`."""

    def __init__(self, intake: Intake, guard: Guard, meters: Meters) -> None:
        self._intake = intake
        self._guard = guard
        self._meters = meters

    async def hand_in(self, diff: bytes, bearer: str) -> Acknowledgement:
        """What becomes of a diff of a known bearer; once it says accepted, the diff is durable."""
        arrived = time.perf_counter()
        sha256 = hashlib.sha256(diff).hexdigest()
        try:
            self._guard.count(bearer)
            self._guard.count_bytes(bearer, len(diff))
            update = await self._intake.take_in(diff, self._guard.sender(bearer))
        except HTTPException as error:
            wait_s = float((error.headers or {}).get("Retry-After", BUSY_WAIT_S))
            verdict = Verdict.LATER if error.status_code == HTTPStatus.TOO_MANY_REQUESTS else Verdict.REFUSED
            reason = self._guard.refused(bearer, error)
            acknowledgement = Acknowledgement(sha256, verdict, error.detail, wait_s=wait_s)
        except WireError as error:
            reason = self._guard.refused(bearer, error)
            acknowledgement = Acknowledgement(sha256, Verdict.REFUSED, str(error))
        except BusyError as error:
            reason = "busy"
            acknowledgement = Acknowledgement(sha256, Verdict.LATER, str(error), wait_s=BUSY_WAIT_S)
        except StoreError:
            reason = "not_kept"
            acknowledgement = Acknowledgement(sha256, Verdict.LATER, "the diff could not be kept", wait_s=BUSY_WAIT_S)
        except Exception as error:
            reason = "internal"
            _log.error("a diff of %d bytes failed", len(diff), exc_info=error)
            acknowledgement = Acknowledgement(sha256, Verdict.LATER, "the service failed at this diff")
        else:
            self._meters.taken_in(update.accepted, len(diff), time.perf_counter() - arrived)
            verdict = Verdict.ACCEPTED if update.accepted else Verdict.REPEATED
            return Acknowledgement(sha256, verdict, map_version=update.version)
        self._meters.refuse(reason)
        return acknowledgement

    def turn_away(self, car: str, reason: str, detail: str, token: str = "") -> None:
        """Count and note a diff of which is not known that its car may hand it in.

        Args:
            car: what it calls itself.
            reason: for the meters, one word.
            detail: one line for a person.
            token: name of the token that it holds, if any.
        """
        self._meters.refuse(reason)
        self._guard.turned_away(token, reason, f"by MQTT from {car}: {detail}")
