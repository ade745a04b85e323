"""Several cars at a clock that the test turns."""

from dataclasses import dataclass, field, replace
from heapq import heappop, heappush

from street import Street

from autowaze.vehicle.outbox import Outbox
from autowaze.vehicle.uplink import Delivery
from autowaze.world.wire import encode_diff

WINDOW_S = 15.0


@dataclass
class Car:
    """Makes a diff every window and delivers by the clock.

    Attributes:
        made: every diff, in order.
        attempts: times at which it tried.
    """

    delivery: Delivery
    made: list[bytes] = field(default_factory=list)
    attempts: list[float] = field(default_factory=list)
    idle: bool = True


class Fleet:
    """Cars that drive from time 0 on; `run` turns the clock from event to event."""

    def __init__(self, folder, transports, randomness):
        self.now = 0.0
        self.cars = [Car(Delivery(Outbox(folder / str(n)), t, randomness)) for n, t in enumerate(transports)]
        seen = Street(count=2).drive(Street(count=2).park([0]))[0]
        self._diff = replace(seen, new=seen.new[:0], trajectory=seen.trajectory[:0])
        self._events = []
        for number in range(len(self.cars)):
            heappush(self._events, (WINDOW_S * (number + 1) / len(self.cars), number, "window"))

    def run(self, until, driving=True):
        while self._events and self._events[0][0] <= until:
            self.now, number, what = heappop(self._events)
            car = self.cars[number]
            if what == "window":
                if driving:
                    self._make_diff(number, car)
                    heappush(self._events, (self.now + WINDOW_S, number, "window"))
                if not car.idle:
                    continue
            self._attempt(number, car)
        self.now = max(self.now, until)

    def caught_up(self):
        return all(len(car.delivery.outbox) == 0 for car in self.cars)

    def close(self):
        for car in self.cars:
            car.delivery.close()

    def _make_diff(self, number, car):
        start = 1000.0 + self.now
        key, window = (number + 1, len(car.made)), (start, start + WINDOW_S)
        diff = replace(self._diff, session=key[0], sequence=key[1], start=window[0], end=window[1])
        car.made.append(encode_diff(diff))
        car.delivery.outbox.put(car.made[-1])

    def _attempt(self, number, car):
        car.attempts.append(self.now)
        wait_s = car.delivery.attempt()
        car.idle = wait_s is None
        if wait_s is not None:
            heappush(self._events, (self.now + wait_s, number, "attempt"))
