"""A service in a process of its own: reads a file of messages, writes the number of each that is acknowledged."""

import pickle
import sys
from pathlib import Path

from street import Street

from autowaze.cloud.durable import DurableService
from autowaze.cloud.service import CloudService
from autowaze.cloud.store import open_store

store, messages, street = sys.argv[1], pickle.loads(Path(sys.argv[2]).read_bytes()), Street(count=int(sys.argv[3]))
durable = DurableService(lambda: CloudService(street.parking_map), open_store(store))
for number, message in enumerate(messages):
    durable.receive(message)
    if number % 7 == 6:
        durable.snapshot()
    print(number, flush=True)
