"""A street as the renderer wants it: surfaces, models, and where they stand."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from autowaze.simulator.mesh import Mesh
from autowaze.world.labels import ClassLabel


@dataclass(frozen=True)
class Surface:
    """A texture and how light meets it.

    Attributes:
        texture: (H, W, 4) uint8, RGB and alpha; alpha is the finish (`surfaces.finish`) of an opaque surface, else
            the coverage.
        cutout: texels of low coverage are not there (leaves, fences).
        decal: blended onto what lies below (paint on the road, shadows under cars).
        gloss: how strongly tinted texels mirror, 0..1.
        glow: light of its own, added.
        wettable: gets dark and mirroring in the rain.
        underfoot: lies flat below everything, so it is drawn after what hides it.
    """

    texture: NDArray[np.uint8]
    cutout: bool = False
    decal: bool = False
    gloss: float = 0.0
    glow: float = 0.0
    wettable: bool = False
    underfoot: bool = False


@dataclass(frozen=True)
class Model:
    """Meshes with the names of their surfaces; `far` replaces them beyond `far_from_m`."""

    near: tuple[tuple[Mesh, str], ...]
    far: tuple[tuple[Mesh, str], ...] | None = None
    far_from_m: float = 16.0


@dataclass(frozen=True)
class Thing:
    """One instance of a model.

    Attributes:
        T_map_thing: (4, 4), may scale.
        tint: RGB 0..255.
        id: instance id; 0 for what does not come and go.
        size: length, width, height in metres.
    """

    model: str
    T_map_thing: NDArray[np.float64]
    tint: tuple[int, int, int] = (255, 255, 255)
    id: int = 0
    label: ClassLabel = ClassLabel.BACKGROUND
    size: tuple[float, float, float] = (0.0, 0.0, 0.0)
    kind: str = ""

    def moved_to(self, T_map_thing: NDArray[np.float64]) -> Thing:
        """The same thing elsewhere; the scale stays."""
        scale = np.linalg.norm(self.T_map_thing[:3, 0])
        T = T_map_thing.copy()
        T[:3, :3] *= scale
        return replace(self, T_map_thing=T)


@dataclass
class Scene:
    """All that can be seen.

    Attributes:
        ground: static geometry in map metres, with the names of surfaces; `fine` marks what is too small to be seen
            from afar.
        things: what stands still for the whole drive.
    """

    surfaces: dict[str, Surface] = field(default_factory=dict)
    models: dict[str, Model] = field(default_factory=dict)
    ground: list[tuple[Mesh, str, bool]] = field(default_factory=list)
    things: list[Thing] = field(default_factory=list)

    def add(self, mesh: Mesh, surface: str, fine: bool = False) -> None:
        """Put static geometry into the scene."""
        if len(mesh):
            self.ground.append((mesh, surface, fine))
