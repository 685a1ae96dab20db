"""A sound server for the tests that need an audio device."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

import pytest

from tests.live.servers import Server, dummy_server, missing


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    # Two servers at once get into each other's way: JACK then refuses clients of either.
    for item in items:
        if "jack" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group("jack"))


@pytest.fixture(scope="session")
def jack(worker_id: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    if missing():
        pytest.skip(f"NO AUDIO DEVICE WAS TESTED: {missing()}")
    name = f"struck-{os.getpid()}-{worker_id}"
    with dummy_server(name, tmp_path_factory.mktemp("jack")) as server:
        yield server
