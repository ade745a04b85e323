"""The ways from points to spots that can be compared; all of them run through the same service."""

from __future__ import annotations

from dataclasses import dataclass

from autowaze.world.errors import AutowazeError


@dataclass(frozen=True)
class Method:
    """One way; `dataclasses.replace(FUSED, ground=False)` makes an ablation.

    Attributes:
        name: as in tables.
        labels: keep only features with a vehicle's label; else every feature near the spots counts.
        removals: take removed features out of the map.
        instance_ids: group by instance (thesis, sec. 3.3.2); else by density (DBSCAN).
        outlier_removal: neighbourhood outlier removal (thesis, sec. 3.3.3).
        visible_side: place boxes knowing that only the side towards the camera yields points; else around the centroid.
        second_pass: cull spots with significant overlap (thesis, sec. 3.3.5).
        belief: weigh evidence per spot over time; else decide by the boxes of the map as it is.
        ground: free ground and obstacles count as evidence, not only to tell where a car looked.
        memory: the belief carries over from one pass of a car to the next; else the newest pass decides.
        corroboration: what several sources agree on is not overturned by one alone, and none speaks twice.
    """

    name: str
    labels: bool = True
    removals: bool = True
    instance_ids: bool = True
    outlier_removal: bool = True
    visible_side: bool = False
    second_pass: bool = True
    belief: bool = False
    ground: bool = False
    memory: bool = True
    corroboration: bool = False


THESIS = Method("thesis")
FUSED = Method("fused", visible_side=True, belief=True, ground=True, corroboration=True)
CARMAP = Method("carmap", removals=False, instance_ids=False, outlier_removal=False, second_pass=False)
"""CarMap (NSDI 2020) as the thesis uses it (sec. 4.1.4): additions only, vehicle features, DBSCAN."""
ORB_SLAM2 = Method(
    "orb-slam2", labels=False, removals=False, instance_ids=False, outlier_removal=False, second_pass=False
)
"""Visual SLAM as the thesis uses it (sec. 4.1.4): every feature without label, DBSCAN."""

METHODS = {method.name: method for method in (FUSED, THESIS, CARMAP, ORB_SLAM2)}


def method_named(name: str) -> Method:
    """The method of this name; raises `AutowazeError` with the names there are."""
    if name not in METHODS:
        raise AutowazeError(f"unknown method {name!r}: use one of {', '.join(METHODS)}")
    return METHODS[name]
