"""A sound server for the tests that need an audio device."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from tests.live.servers import Server, dummy_server, missing


@pytest.fixture(scope="session")
def jack(worker_id: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    if missing():
        pytest.skip(f"NO AUDIO DEVICE WAS TESTED: {missing()}")
    name = f"struck-{os.getpid()}-{worker_id}"
    with dummy_server(name, tmp_path_factory.mktemp("jack")) as server:
        yield server
