"""One drive through a street: where everything is in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.actors import Actor
from autowaze.simulator.ego import EgoMotion, drive_along
from autowaze.simulator.gnss import receive_fixes
from autowaze.simulator.parking import contact_shadow
from autowaze.simulator.scene import Thing
from autowaze.simulator.street import Street
from autowaze.simulator.traffic import stage_traffic
from autowaze.simulator.truth import VehicleState, is_vehicle, occupying_vehicle, vehicle_state
from autowaze.world.frame import GnssFix


@dataclass(frozen=True)
class Drive:
    """A street with its traffic and the ego vehicle's motion through it.

    Attributes:
        still: things that never move during the drive and are not part of the street itself.
        actors: things that do, with a pose per frame.
    """

    street: Street
    ego: EgoMotion
    still: tuple[Thing, ...]
    actors: tuple[Actor, ...]
    fixes: tuple[GnssFix, ...]

    def __len__(self) -> int:
        return len(self.ego)

    def moving_things(self, frame: int) -> list[Thing]:
        """Actors where they are in a frame, with the dark under vehicles."""
        things = []
        for actor in self.actors:
            thing = actor.in_frame(frame)
            if thing is not None:
                things.append(thing)
                if is_vehicle(thing):
                    things.append(contact_shadow(thing))
        return things

    def vehicles(self, frame: int) -> list[VehicleState]:
        """Boxes of all cars and trucks in a frame."""
        moving = [thing for thing in self.moving_things(frame) if is_vehicle(thing)]
        return [vehicle_state(thing) for thing in (*self.still, *moving) if is_vehicle(thing)]

    def occupants(self) -> dict[str, NDArray[np.int64]]:
        """By spot the id of the vehicle on it in every frame, 0 when it is vacant."""
        table: dict[str, NDArray[np.int64]] = {}
        per_frame = [self.vehicles(frame) for frame in range(len(self))]
        changing = {actor.thing.id for actor in self.actors}
        still = [vehicle_state(thing) for thing in self.still if is_vehicle(thing)]
        for bay in self.street.plan.bays:
            constant = occupying_vehicle(bay, still)
            column = np.full(len(self), constant or 0, dtype=np.int64)
            if constant is None and changing:
                column[:] = [occupying_vehicle(bay, vehicles) or 0 for vehicles in per_frame]
            table[bay.id] = column
        return table


def stage_drive(street: Street) -> Drive:
    """Let the ego vehicle and everyone else move through a street."""
    description = street.description

    def rng(number: int) -> np.random.Generator:
        return np.random.default_rng([description.seed, description.drive, number])

    traffic = stage_traffic(street, rng(11))
    ego = drive_along(traffic.route, description, rng(10))
    actors, still = traffic.timed(ego)
    cars = [car.thing for car in street.parked if car.thing.id not in {actor.thing.id for actor in actors}]
    everything = [*cars, *still]
    shadows = [contact_shadow(thing) for thing in everything if is_vehicle(thing)]
    fixes = receive_fixes(ego, street.plan.georeference, rng(12)) if description.ego.gnss else []
    return Drive(street, ego, (*everything, *shadows), tuple(actors), tuple(fixes))
