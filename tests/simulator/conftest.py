"""One small street for all tests of the simulator: textures and geometry take seconds to make."""

from collections.abc import Iterator

import pytest
from small_street import small_street

from autowaze.simulator import SimulatedTrace


@pytest.fixture(scope="session")
def trace() -> Iterator[SimulatedTrace]:
    simulated = SimulatedTrace(small_street())
    yield simulated
    simulated.close()
