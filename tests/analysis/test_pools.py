"""Pools of processes: what they return is what one process makes, bit for bit where it can be."""

from __future__ import annotations

import multiprocessing
import re
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.model.arrays import Array
from struck.solids import Block, Tube

BODIES, PROCESSES = 24, 4
MOST_KILOBYTES = 2**20


def memory(kind: str) -> int:
    """Return the present ("VmRSS") or the highest ("VmHWM") memory of this process, kB."""
    # What getrusage tells is kept over an exec: a process that is spawned starts at its parent's.
    return int(re.findall(rf"{kind}:\s*(\d+)", Path("/proc/self/status").read_text())[0])


_begun = {"kB": memory("VmRSS")}


def begin() -> None:
    """Note what a process of a pool has from its parent, or from importing this."""
    _begun["kB"] = memory("VmRSS")


def made(number: int) -> tuple[Array, Array, int]:
    """Return the frequencies and the sound of a random body, and the memory they took, kB."""
    chance = np.random.default_rng([40, number])
    size = 10 ** chance.uniform(-0.9, -0.5)
    solid = (
        Block(size=(size, size * chance.uniform(0.1, 1), size * chance.uniform(0.02, 0.2)))
        if number % 2
        else Tube(length=size, radius=size / chance.uniform(4, 20), wall=size / 100)
    )
    material = ("steel", "glass", "oak", "bronze")[number % 4]
    model = struck.analyze(solid, material, accuracy="preview", band=(20, 6_000), cache=False)
    sound = struck.render(model, struck.Strike(), seconds=0.1)
    return model.frequencies, sound.samples, memory("VmHWM") - _begun["kB"]


@cache
def alone(number: int) -> tuple[Array, Array, int]:
    return made(number)


@pytest.mark.prove
@pytest.mark.parametrize("way", ["fork", "spawn"])
def test_a_pool_makes_what_one_process_makes(way: str) -> None:
    expected = [alone(number) for number in range(BODIES)]  # before, as that is what once hung
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads that a fork leaves behind
        with multiprocessing.get_context(way).Pool(PROCESSES, begin) as pool:
            found = pool.map_async(made, range(BODIES), chunksize=1).get(timeout=600)
    for (frequencies, samples, added), (own, heard, _) in zip(found, expected, strict=True):
        assert added < MOST_KILOBYTES
        assert frequencies.tobytes() == own.tobytes()
        assert samples.tobytes() == heard.tobytes()
