"""An OpenGL context without a screen, and the programs that run on it."""

from __future__ import annotations

import os
from importlib import resources
from typing import Any

from autowaze.world.errors import DependencyError

_PACKAGES = "libegl1 libgl1 libgl1-mesa-dri"
_HEADER = "#version 330\n"


def open_context(threads: int | None = None) -> Any:
    """A moderngl context on EGL; `threads` caps those of Mesa's software rasteriser.

    Raises:
        DependencyError: EGL or a driver is missing; says which Debian packages bring them.
    """
    import moderngl

    if threads is not None:
        os.environ["LP_NUM_THREADS"] = str(threads)
    try:
        # through Any: the package's annotations take the backend's keywords for dictionaries
        create: Any = moderngl.create_standalone_context
        return create(require=330, backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1")
    except Exception as error:  # moderngl raises plain Exception, ImportError or OSError by what is missing
        raise DependencyError(
            f"the simulator cannot open OpenGL on EGL ({error}); install it with: apt-get install {_PACKAGES}"
        ) from error


def build_program(context: Any, vertex: str, fragment: str, define: str | None = None) -> Any:
    """Compile two shaders of the `shaders` folder."""
    header = _HEADER + (f"#define {define}\n" if define else "")
    return context.program(vertex_shader=header + _source(vertex), fragment_shader=header + _source(fragment))


def _source(name: str) -> str:
    return resources.files("autowaze.simulator.render").joinpath("shaders", name).read_text(encoding="utf-8")
