"""Calls of all entries of the core by chance, within what their callers promise."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from struck import core as binding
from struck.ears.delay_lines import READ, hear, interpolation_kernel
from struck.excitation.excitation import Push
from struck.excitation.roughness import Roughness
from struck.excitation.scraping_force import Levels, Reader, SlidingContact, add_reading
from struck.excitation.texture import Layers, add_heights
from struck.excitation.touch import (
    Lines,
    expect_gaps,
    join_lines,
    numbers_at,
    sample_lines,
    smooth_numbers,
)
from struck.live import callback_memory, limiter, ring
from struck.live.ears import EarsMemory
from struck.model.arrays import AnyArray, Array, Index, Single
from struck.model.exponentials import Exponentials
from struck.model.gains import shapes_along
from struck.model.mesh import part_mesh
from struck.radiation.boundary_elements import BoundaryElements
from struck.recordings.noise import Noise
from struck.recordings.poles.normal_equations import add_unique, take_turns
from struck.recordings.poles.refinement import blocks_around, find_groups
from struck.recordings.poles.uncertainty import pole_statistics
from struck.recordings.segments import Segment
from struck.shapes.bessel_series import series, series_slope
from struck.synth.poles import Poles
from struck.synth.resonators import Resonators, Stepped
from tests.live.records import pop, push
from tests.synth.scenes import Bank

Random = np.random.Generator
Keep = Callable[[AnyArray], AnyArray]


def _modes(random: Random, count: int) -> Bank:
    frequencies = random.uniform(20, 30000, count)  # some beyond half the rate
    return Bank(frequencies, random.uniform(0, 300, count))


def _gains(random: Random, shape: tuple[int, ...]) -> AnyArray:
    real = random.standard_normal(shape)
    return real + 1j * random.standard_normal(shape) if random.random() < 0.7 else real + 0j


def bank(random: Random, blocks: int = 8) -> Iterator[Array]:
    """Yield what bodies sound like that are pushed, changed and heard by chance."""
    counts = random.choice([1, 2, 7, 8, 9, 31, 100], random.integers(1, 4))
    block = int(random.choice([1, 2, 3, 8, 17, 32, 50]))
    points, voices = int(random.choice([1, 2, 3, 5, 9])), int(random.integers(1, 12))
    bodies = [_modes(random, count) for count in counts]
    size = {"block": block, "points": points, "voices": voices}
    resonators = Resonators(bodies, **size, quiet=0.3)
    pushes: list[Push] = []
    for number in range(blocks):
        if number % 3 == 0:
            where = random.integers(len(counts), size=random.integers(voices + 1))
            drives = [random.standard_normal(counts[body]) for body in where]
            pushes = [
                Push(force=np.zeros(block), drive=drive, body=int(body), voice=voice)
                for voice, (body, drive) in enumerate(zip(where, drives, strict=True))
            ]
        for each in pushes:
            each.force[:] = random.standard_normal(block)
        outputs: list[Any] = []
        if number == 0 or random.random() < 0.3:
            outputs = [_gains(random, (points, count)) for count in counts]
        yield resonators.process(pushes, outputs).copy()
        if random.random() < 0.2:
            body = int(random.integers(len(counts)))
            resonators.change(body, _modes(random, counts[body]))
            yield resonators.states(body).view(np.float64)


def ears(random: Random, blocks: int = 4) -> Iterator[Single]:
    """Yield what ears hear along paths of which all is random."""
    lines, paths, heard_by = (int(each) for each in random.integers(1, 4, 3))
    block, taps = int(random.choice([1, 5, 64, 300])), 4 * int(random.integers(1, 9))
    half = 1 << int(random.integers(9, 11))
    room = taps - 1 + block + int(random.integers(3))
    history, now = np.zeros((paths, room), np.float32), int(random.integers(0, 10**6))
    for number in range(blocks):
        line = random.standard_normal((lines, half)).astype(np.float32)
        heard = np.zeros((heard_by, block), np.float32)
        before, after = random.standard_normal((2, paths, taps)).astype(np.float32)
        hear(
            *(np.concatenate([line, line], axis=1), now, interpolation_kernel()),
            *(random.integers(lines, size=paths), random.integers(heard_by, size=paths)),
            *(
                random.uniform(0, half - block - READ, (paths, 3)),
                random.standard_normal((paths, 3)),
            ),
            *(before, after, number * block, blocks * block, history, heard),
        )
        now += block
        yield heard


def rough(random: Random) -> Iterator[Array]:
    """Yield readings of a random surface."""
    counts = random.integers(4, 60, random.integers(1, 6))
    values = random.standard_normal(counts.sum()).astype(np.float32)
    table = Levels(values=values, starts=np.cumsum(counts) - counts, counts=counts)
    turns = random.uniform(-3, 3, random.integers(1, 90))
    turns[0] = random.choice([-1e-20, 0, 1, np.nextafter(1, 0)])
    out, levels = np.zeros(len(turns)), random.uniform(0, len(counts) + 1, 2).tolist()
    add_reading(table, turns, levels, random.normal(size=2).tolist(), out)
    yield out
    name = random.choice(["wood", "sandpaper"])
    rubbed = SlidingContact(roughness=Roughness.named(name), modulus=1e10, radius=1e-3)
    speeds, loads = 10 ** random.uniform(-300, 300, (2, random.integers(1, 40)))
    yield Reader(rubbed, 48_000).weights_at(speeds, np.minimum(loads, 1e6))


def textured(random: Random) -> Iterator[Array]:
    """Yield readings of a random texture, at some places that are none."""
    layers = Layers.of(random.uniform(1e-3, 1, random.integers(1, 6)), np.ones(1), 3)
    count, first = int(random.integers(1, 200)), int(random.integers(0, 64))
    places = np.cumsum(random.normal(0, 0.01, (count, 3)), axis=0)
    places[random.integers(count)] = random.choice([0, np.nan, np.inf, 1e30])
    weights = random.normal(size=((first + count - 1) // 64 + 2, len(layers.seeds)))
    out = np.zeros(count)
    add_heights(layers, weights, first, places, out)
    yield out


def lined(random: Random) -> Iterator[Array]:
    """Yield numbers that move in random lines."""
    (begins, lengths, lows, highs), begin, end = random_lines(random)
    lines = begins, lengths, join_lines(begins, lengths, lows[0], highs), highs
    columns = lows.shape[1]
    yield sample_lines(lines, begin, end, int(random.integers(1, columns + 1)))
    moments = np.sort(random.integers(begin, end, random.integers(1, 9))) + 1
    yield numbers_at(lines, moments, int(random.integers(columns)))
    yield expect_gaps(random.integers(0, 1000, random.integers(1, 9)), 40.0, 960.0, 480.0)[0]
    taps = int(random.integers(1, 99))
    yield smooth_numbers(random.standard_normal(taps + int(random.integers(0, 99))), np.ones(taps))


def shaped(random: Random) -> Iterator[Array]:
    """Yield random mode shapes along pushes."""
    points, shapes, corners, places, ways = random_shapes(random)
    corners[0] = corners[0, 0]  # a face without an area
    yield shapes_along(points, shapes, corners, places, ways)


def random_shapes(random: Random) -> tuple[Array, Single, Index, Array, Array]:
    """Return points and shapes, the corners of faces, places and ways."""
    vertices, modes, pushes = (int(each) for each in random.integers(3, 40, 3))
    shapes = random.standard_normal((vertices, 3, modes)).astype(np.float32)
    corners = random.random((pushes, vertices)).argsort(axis=1)[:, :3].copy()
    places, ways = random.standard_normal((2, pushes, 3))
    return random.standard_normal((vertices, 3)), shapes, corners, places, ways


def layered(random: Random) -> Iterator[Array]:
    """Yield layers of random triangles, one of them without an area, at their centres and off."""
    vertices, faces = int(random.integers(4, 40)), int(random.integers(1, 70))
    corners = random.random((faces, vertices)).argsort(axis=1)[:, :3]
    corners[0] = corners[0, 0]
    mesh = part_mesh(random.standard_normal((vertices, 3)), corners)
    elements, wave_number = BoundaryElements.of(mesh), 10 ** random.uniform(-9, 3)
    doubles = np.empty((faces, faces + int(random.integers(3))), np.complex128)
    singles = elements.layers(mesh.centroids, wave_number, doubles, 0)
    yield from (singles.view(np.float64), doubles[:, :faces].copy().view(np.float64))
    places = random.standard_normal((int(random.integers(1, 9)), 3))
    places[0] = mesh.points[0]
    doubles = np.empty((len(places), faces), np.complex128)
    yield elements.layers(places, wave_number, doubles).view(np.float64)
    yield doubles.view(np.float64)


def random_lines(random: Random) -> tuple[Lines, int, int]:
    """Return lines, some of which end where they begin, and the samples that read them."""
    count, columns, begin = int(random.integers(1, 9)), int(random.integers(1, 9)), 1000
    begins = np.sort(random.integers(begin, begin + 300, count))
    begins[0] = begin - random.integers(1, 50)
    lengths = random.integers(1, 120, count)
    lows, highs = random.standard_normal((2, count, columns))
    return (begins, lengths, lows, highs), begin, begin + int(random.integers(1, 400))


def summed(random: Random) -> Iterator[Array]:
    """Yield sums of random series."""
    cells, count = (int(each) for each in random.integers(1, 20, 2))
    table = random.standard_normal((cells, 13, count))
    arguments = random.uniform(0, cells, random.integers(1, 40))
    arguments[0] = random.choice([0, np.nextafter(cells, 0)])
    yield from (series(arguments, table), series_slope(arguments, table))


def limited(random: Random, blocks: int = 8) -> Iterator[Array]:
    """Yield limited noise, spoiled here and there, and the state of the limiter."""
    channels, block = int(random.integers(1, 4)), int(random.integers(1, 200))
    look_ahead, hold = random.uniform(1e-5, 3e-3), random.choice([0, 0.002])
    state = limiter.limiter(
        sample_rate=8000, channels=channels, look_ahead=look_ahead, hold=hold, fade=0.01
    )
    for _ in range(blocks):
        samples = random.standard_normal((channels, block)) * 10 ** random.uniform(-2, 2)
        spoiled = random.choice([1, np.nan, np.inf])
        samples[random.integers(channels), random.integers(block)] = spoiled
        limiter.limit(state, samples, bool(random.random() < 0.7))
        compiled = binding.compiled("limiter_is_closed")
        assert bool(compiled(state)) == limiter.is_closed(state)
        yield samples
    yield state


def queued(random: Random) -> Iterator[Array]:
    """Yield records that went through a queue."""
    sizes = {"integers": int(random.integers(4)), "reals": int(random.integers(4))}
    records = ring.Ring(capacity=int(random.integers(1, 5)), **sizes)
    integers, reals = np.zeros(sizes["integers"], np.int64), np.zeros(sizes["reals"])
    for _ in range(20):
        if random.random() < 0.6:
            push(records, random.integers(9, size=len(integers)), random.normal(size=len(reals)))
        elif pop(records.memory, integers, reals):
            yield np.concatenate([integers.astype(float), reals])


def fitted(random: Random) -> Iterator[Array]:
    """Yield refined poles and their statistics from noise of random lengths."""
    count = int(random.integers(1, 12))
    poles = -random.uniform(1, 200, count) + 2j * np.pi * random.uniform(100, 3900, count)
    segments, row = [], 0
    for _ in range(random.integers(1, 4)):
        channels, length = int(random.integers(1, 4)), int(random.integers(300, 3000))
        noise, heard = Noise.white(np.ones(channels)), random.standard_normal((channels, length))
        segments.append(Segment.of(heard, 8000, noise, row))
        row += channels
    gains = random.standard_normal((row, count)) + 1j * random.standard_normal((row, count))
    blocks = blocks_around(segments, poles, find_groups(poles, 0.3, random.uniform(0.001, 0.5)))
    start, keep = poles[blocks.members], bool(random.integers(2))
    yield from (
        np.ascontiguousarray(each).view(np.float64)
        for each in take_turns(blocks, poles, gains, start, blocks.starts, 2, keep=keep)
    )
    energies, shares = np.zeros(count), np.zeros(count)
    add_unique(blocks, poles, gains, energies, shares)
    found = pole_statistics(segments, Exponentials(poles=poles, gains=gains))
    yield from (energies, shares, found.variances, found.sizes, found.energies, found.whole)


def called_back(random: Random, keep: Keep = lambda array: array) -> Iterator[Single]:
    """Yield what a device gets of random records; `keep` puts arrays where they shall lie."""
    counts = random.choice([1, 7, 8, 30], random.integers(1, 4))
    voices, block, points = (int(each) for each in random.integers(1, (5, 65, 3)))
    channels, heard = int(random.integers(1, 4)), bool(random.integers(2))
    poles = [Poles.of(_modes(random, count), 48000) for count in counts]
    size = {"points": points, "block": block, "voices": voices}
    stepped = Stepped(poles, **size, sample_rate=48000, quiet=0.1)
    arena = callback_memory.arena(stepped, volume=0.1)
    arena.last = keep(np.zeros((len(counts), points)))  # as for ears of so many points
    arena.beside, arena.points = arena.last.ctypes.data, points
    kept, sizes = [], {}
    if heard:
        memory, arrays = _ears_memory(random, len(counts), block, keep)
        arena.ears, sizes = ctypes.pointer(memory), {"paths": memory.paths, "taps": memory.taps}
        kept += [memory, arrays]
    layout = ring.Layout.of(stepped.memory, points, **sizes)
    records = ring.Ring(capacity=2, integers=layout.integers, reals=layout.reals)
    records.memory = keep(records.memory)
    limits = keep(limiter.limiter(sample_rate=48000, channels=channels))
    given = {"arena": arena, "channels": channels, "block": block}
    shared = callback_memory.Shared(records=records, limited=limits, **given)
    mix = keep(np.zeros(channels * block))
    shared._places.mix = mix.ctypes.data
    place, word = ctypes.c_void_p, ctypes.c_ulong
    prototype = ctypes.CFUNCTYPE(ctypes.c_int, place, place, word, place, word, place)
    play, frames = prototype(callback_memory.play()), keep(np.zeros((block, channels), np.float32))
    for number in range(12):
        slot = records.reserve() if random.random() < 0.7 else None
        if slot is not None:
            _write(random, layout.record(*slot), len(counts), block, first=number == 0)
            records.publish()
        shared.counters[callback_memory.OPEN] = random.random() < 0.9
        play(None, frames.ctypes.data, block, None, int(random.integers(8)), shared.address)
        yield frames.copy()


def _ears_memory(random: Random, lines: int, block: int, keep: Keep) -> tuple[Any, Any]:
    paths, taps, listening = lines * 2, 8 * int(random.integers(1, 4)), 2
    table, half = interpolation_kernel(), 256
    arrays = {
        "line": np.zeros((lines, 2 * half), np.float32),
        "between": table,
        "before": np.zeros((paths, taps), np.float32),
        "after": np.zeros((paths, taps), np.float32),
        "history": np.zeros((paths, taps - 1 + block), np.float32),
        "heard": np.zeros((listening, block), np.float32),
        "ways": np.zeros((2, paths, 3)),
        "line_of": np.repeat(np.arange(lines), listening),
        "ear_of": np.tile(np.arange(listening), lines),
    }
    arrays = {name: keep(array) for name, array in arrays.items()}
    numbers = {"lines": lines, "length": 2 * half, "fine": len(table) - 1, "paths": paths}
    numbers |= {"taps": taps, "ears": listening, "block": block, "stretch": 4 * block, "now": 0}
    places = {name: array.ctypes.data for name, array in arrays.items()}
    return EarsMemory(**numbers, **places), arrays


def _write(random: Random, record: ring.Record, bodies: int, block: int, *, first: bool) -> None:
    loads, sounds = (record.loads, record.forces), (record.beside, record.responses)
    for each in (*loads, *sounds, record.drives, record.outputs):
        each[...] = random.standard_normal(each.shape)
    record.volume[0] = random.uniform(0, 1)
    record.poles[0], record.poles[1] = -1e-4, random.uniform(0, 3, record.poles.shape[1])
    record.poles[:, random.random(record.poles.shape[1]) < 0.1] = 0
    begun = ring.BEGIN if first else random.choice([ring.SILENT, ring.ON, ring.BEGIN])
    record.voices[:, ring.STATE] = begun
    record.voices[:, ring.OF_BODY] = random.integers(bodies, size=len(record.voices))
    record.voices[:, ring.MOVED] = begun == ring.BEGIN or random.integers(2)
    record.bodies[:] = 7 if first else random.choice([0, 1, 2, 3])
    record.stretch[:] = random.integers(2), block * random.integers(4)
    record.ways[0] = random.uniform(16, 256 - block - READ, record.ways[0].shape)
    record.ways[1] = random.standard_normal(record.ways[1].shape)


ALL = (bank, ears, rough, textured, lined, shaped, layered, summed, limited, queued, fitted)
