"""Structure-aware changes of files: each takes the bytes of a file and returns other bytes.

A change that finds no structure of its kind in the bytes returns bytes changed anywhere. The same
`chance` gives the same bytes.
"""

from __future__ import annotations

import base64
import bz2
import contextlib
import copy
import gzip
import hashlib
import io
import json
import lzma
import re
import struct
import warnings
import zipfile
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from random import Random
from typing import Any
from xml.etree import ElementTree as ET

import h5py
import numpy as np

Mutation = Callable[[bytes, Random], bytes]

FEW = (1, 1, 1, 2, 3)  # changes at once

NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
# Replacements of a number in a text.
NUMBERS = (
    *("nan", "inf", "-inf", "1e309", "-1e309", "1e308", "-1.7e308", "1e155", "1e-320", "-0.0"),
    *("-1", "0", "1", "3", "7", "255", "65536", "2147483647", "2147483648", "4294967295"),
    *("-2147483649", "9223372036854775807", "9223372036854775808", "1e9", "1000000000", "0x10"),
    *("9" * 26, "9" * 400, "9" * 5000, "1.5", "", "x", "1/2/3", "1_0", "-", "null", "[]"),
)
# Replacements of a value in a tree of JSON.
LEAVES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1, 3, 80, 2**31, 2**63, 10**9, 10**400, 1.5, 1e308, -1e308, 1e-320),
    *(float("nan"), float("inf"), "", "x", "../x", "a\0b", "\x1b[31m", "\ud800", "9" * 300),
    *([], {}, [[]], [0], [0, 0], [None], ["x", 1], {"x": {}}, [1e38] * 16, [1e200] * 3),
    *([float("inf")] * 3, 5120, 5121, 5123, 5125, 5126, "SCALAR", "VEC2", "VEC3", "MAT4", 4, 5, 6),
)
# Texts of JSON that no value of Python is written as, each by the text that stands for it.
RAW = {
    "\ue000deep": "[" * 50_000,
    "\ue000nested": "[" * 900 + "]" * 900,
    "\ue000digits": "9" * 5000,
    "\ue000huge": "1e999",
    "\ue000twice": '{"a": 1, "a": 2}',
}
# Elements and attributes of scenes that cost much, or lead elsewhere.
XML_PIECES = (
    '<include file="part.xml"/>',
    '<include file="../part.xml"/>',
    '<replicate count="3000"><body><geom size=".1"/></body></replicate>',
    '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>',
    '<asset><mesh name="gone" file="gone.stl"/></asset>',
    '<composite type="cable" count="9 1 1" size="1"/>',
    '<body><inertial pos="0 0 0" mass="-1" diaginertia="0 0 0"/></body>',
    '<size memory="100G"/>',
    '<option timestep="0" integrator="RK4"/>',
    '<plugin plugin="gone"/>',
    '<mesh filename="package://x/../../y.stl"/>',
)
TOML_VALUES = (
    *("nan", "-inf", "true", "1979-05-27T07:32:00Z", "[]", "{}", '""', '"x"', '"../x"', "-1", "0"),
    *("1e308", "9" * 400, "0x" + "f" * 300, "[" * 500, "[1, 2", '"\\u0000"', '"\\u001b[31m"'),
    *("[[1], 2]", "[0.1, nan]", "{a = 1}", "'''x\ny'''", "1_0", "65536", "2.5", '[""]'),
)
CELLS = (
    *NUMBERS,
    *('"', '"x', '"a,b"', "'", "../x", "\x1b[31m", "\0", " ", "1,5", "1;5", "a\tb", "=1+1", "true"),
)
ODD_TEXTS = (
    *(b"\xef\xbb\xbf", b"\0", b"\xff\xfe", b"\xed\xa0\x80", b"\x1b[31m", b"\r", b"\xe2\x80\xa8"),
    *(b" " * 5000, b"\n" * 500, b"#", b'"', b"\\", b"," * 300, b"<![CDATA[", b"<!--", b"&lt;"),
)
WORDS = (
    *(np.float32(value).tobytes() for value in (np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-45, 0)),
    *(np.float64(value).tobytes() for value in (np.nan, np.inf, 1e300, -1e300, 1e-320, 0, 65536)),
    *(number.to_bytes(4, "little") for number in (1, 80, 2**16, 2**31 - 1, 2**31, 2**32 - 1)),
    *(number.to_bytes(4, "big") for number in (1, 80, 2**16, 2**31 - 1, 2**32 - 2)),
    *(number.to_bytes(2, "little") for number in (0, 1, 2**15, 2**16 - 1)),
    (2**63).to_bytes(8, "little"),
)


# Bytes of any kind.


def _block(data: bytes, chance: Random) -> slice:
    start = chance.randrange(len(data) or 1)
    return slice(start, start + chance.choice([1, 4, 12, 50, 400]))


def flip_bits(data: bytes, chance: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(chance.choice(FEW)):
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def truncate(data: bytes, chance: Random) -> bytes:
    return data[: chance.randrange(len(data))]


def insert_bytes(data: bytes, chance: Random) -> bytes:
    place = chance.randrange(len(data))
    return data[:place] + chance.randbytes(chance.choice([1, 2, 4, 30, 1000])) + data[place:]


def delete_block(data: bytes, chance: Random) -> bytes:
    block = _block(data, chance)
    return data[: block.start] + data[block.stop :]


def repeat_block(data: bytes, chance: Random) -> bytes:
    place = chance.randrange(len(data))
    return data[:place] + data[_block(data, chance)] * chance.choice([1, 2, 100]) + data[place:]


def blank_block(data: bytes, chance: Random) -> bytes:
    block = _block(data, chance)
    blank = chance.choice([b"\0", b" ", b"\xff"])
    return data[: block.start] + blank * len(data[block]) + data[block.stop :]


def replace_words(data: bytes, chance: Random, *, near: int = 200) -> bytes:
    """Replace numbers of a binary file, of its first bytes as often as of the rest."""
    changed = bytearray(data)
    for _ in range(chance.choice(FEW)):
        end = len(data) if chance.random() < 0.5 else min(len(data), near)
        word = chance.choice(WORDS)
        place = chance.randrange(max(1, end // 2)) * 2
        changed[place : place + len(word)] = word
    return bytes(changed)


# Text: numbers and lines.


def replace_numbers(data: bytes, chance: Random) -> bytes:
    """Replace numbers of a text, of a header as often as of its body."""
    places = [match.span() for match in NUMBER.finditer(data)]
    near = places[:12] if chance.random() < 0.5 else places
    for start, end in sorted(chance.choices(near, k=chance.choice(FEW)) if near else [])[::-1]:
        data = data[:start] + chance.choice(NUMBERS).encode() + data[end:]
    return data


def move_lines(data: bytes, chance: Random) -> bytes:
    """Shuffle, drop or repeat some lines."""
    lines = data.split(b"\n")
    first = chance.randrange(len(lines))
    rows = lines[first : first + chance.choice([1, 2, 5, len(lines)])]
    changed = chance.choice([chance.sample(rows, len(rows)), [], rows * 2, rows * 50])
    return b"\n".join([*lines[:first], *changed, *lines[first + len(rows) :]])


def insert_odd_text(data: bytes, chance: Random) -> bytes:
    place = chance.choice([0, len(data), chance.randrange(len(data))])
    return data[:place] + chance.choice(ODD_TEXTS) + data[place:]


def encode_otherwise(data: bytes, chance: Random) -> bytes:
    text = data.decode("utf-8", errors="replace")
    return text.encode(chance.choice(["utf-16", "utf-32", "utf-8-sig", "latin-1"]), "replace")


def replace_cells(data: bytes, chance: Random) -> bytes:
    """Replace, drop, repeat or move cells of a table, in one row or in all."""
    head = data.partition(b"\n")[0]
    between = next((mark for mark in (b";", b"\t") if mark in head and b"," not in head), b",")
    rows = [line.split(between) for line in data.split(b"\n")]
    chosen = chance.choice([rows, rows[:1], [chance.choice(rows)], [chance.choice(rows)]])
    column, other = chance.randrange(len(rows[0])), chance.randrange(len(rows[0]))
    cell, change = chance.choice(CELLS).encode(), chance.randrange(4)
    for row in chosen:
        if column < len(row) and change < 2:
            row[column] = cell
        elif column < len(row) and change == 2:
            row[column : column + 1] = chance.choice([[], [row[column]] * 2])
        elif max(column, other) < len(row):
            row[column], row[other] = row[other], row[column]
    return b"\n".join(between.join(row) for row in rows)


_TOML_LINE = re.compile(r"^(\s*)([\w.\"-]+)(\s*=\s*)(.*)$")


def change_toml(data: bytes, chance: Random) -> bytes:
    """Replace values and keys of a TOML text, or the kind of a table."""
    lines = data.decode("utf-8", errors="replace").split("\n")
    places = [number for number, line in enumerate(lines) if "=" in line or "[" in line]
    for number in chance.choices(places, k=chance.choice(FEW)) if places else []:
        match = _TOML_LINE.match(lines[number])
        if match is None:
            lines[number] = chance.choice(
                [
                    lines[number].replace("[[", "[").replace("]]", "]"),
                    "[[x]]",
                    "[" + ".".join("a" * 100) + "]",
                    "",
                ]
            )
            continue
        space, key, equals, value = match.groups()
        keys = [other[2] for line in lines if (other := _TOML_LINE.match(line))]
        other_key = chance.choice([*keys, f"{key}.x", f'"{key} "', ".".join("a" * 200), ""])
        lines[number] = chance.choice(
            [
                *[f"{space}{key}{equals}{chance.choice(TOML_VALUES)}"] * 6,
                f"{space}{other_key}{equals}{value}",
                f"{space}{key}{equals}[{value}]",
                f"{lines[number]}\n{lines[number]}",
            ]
        )
    return "\n".join(lines).encode("utf-8", errors="replace")


# Trees: JSON and XML.


def places_of(tree: dict[str, Any] | list[Any]) -> Iterator[tuple[Any, Any]]:
    """Yield the container and the key or index of each value of a tree."""
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield tree, key
        if isinstance(value, dict | list):
            yield from places_of(value)


def _leaf_like(value: object, chance: Random) -> Any:  # noqa: ANN401 - JSON
    """Return another value, of the same type as often as of any."""
    is_number, is_text = isinstance(value, int | float), isinstance(value, str)
    if (is_number or is_text) and chance.random() < 0.5:
        types = (int, float) if is_number else (str,)
        return chance.choice([leaf for leaf in LEAVES if isinstance(leaf, types)])
    return copy.deepcopy(chance.choice([*LEAVES, *RAW]))


def change_tree(tree: dict[str, Any] | list[Any], chance: Random) -> None:
    """Replace, remove, nest, repeat, rename or exchange one to three values of a tree."""
    for _ in range(chance.choice(FEW)):
        places = list(places_of(tree))
        if not places:
            return
        (container, key), (donor, other) = chance.choice(places), chance.choice(places)
        change = chance.randrange(10)
        if change < 5:
            container[key] = _leaf_like(container[key], chance)
        elif change == 5:
            del container[key]
        elif change == 6:
            container[key] = chance.choice([[container[key]], {"x": container[key]}])
        elif change == 7:
            container[key] = copy.deepcopy(donor[other])
        elif isinstance(container, list):
            container += copy.deepcopy(container) * chance.choice([1, 20])
        else:
            container[chance.choice(["", "x", "__metadata__", "name"])] = container.pop(key)


def json_text(tree: object) -> bytes:
    """Return a tree as JSON, with the texts of `RAW` for what stands for them."""
    text = json.dumps(tree)
    for name, raw in RAW.items():
        text = text.replace(json.dumps(name), raw)
    return text.encode()


def change_json(data: bytes, chance: Random) -> bytes:
    """Change the tree of a JSON text."""
    tree = [json.loads(data)]
    change_tree(tree, chance)
    return json_text(tree[0] if tree else None)


def change_json_lines(data: bytes, chance: Random) -> bytes:
    """Change the trees of some lines of JSON."""
    lines = data.splitlines()
    for number in chance.choices(range(len(lines)), k=chance.choice(FEW)):
        lines[number] = change_json(lines[number], chance)
    return b"\n".join(lines)


def change_xml(data: bytes, chance: Random) -> bytes:
    """Change attributes and elements of an XML text."""
    root = ET.fromstring(data)  # noqa: S314 - a seed of ours
    deep = ""
    for _ in range(chance.choice(FEW)):
        elements = [element for element in root.iter() if isinstance(element.tag, str)]
        element, other = chance.choice(elements), chance.choice(elements)
        name = chance.choice(sorted(element.attrib) or ["name"])
        change = chance.randrange(10)
        if change < 3:
            value = element.get(name, "1").encode()
            element.set(name, replace_numbers(value, chance).decode())
        elif change == 3:
            element.set(name, chance.choice(["", "x", "../x", "part.xml", "-1", "nan", "1e9"]))
        elif change == 4:
            element.attrib.pop(name, None)
        elif change == 5:
            element.set(chance.choice(sorted(other.attrib) or ["x"]), element.get(name, "1"))
        elif change == 6:
            element.append(ET.fromstring(chance.choice(XML_PIECES)))  # noqa: S314 - ours
        elif change == 7 and len(element):
            child = chance.choice(list(element))
            element.extend([copy.deepcopy(child) for _ in range(chance.choice([1, 30]))])
        elif change == 8:
            element.tag = other.tag
        elif element is not root:
            deep, count = element.tag, chance.choice([30, 390, 2000])
            element.append(ET.Comment("deep"))
    text = ET.tostring(root, encoding="unicode")
    if deep:
        text = text.replace("<!--deep-->", f"<{deep}>" * count + f"</{deep}>" * count)
    if chance.random() < 0.05:
        text = f'<!DOCTYPE a [<!ENTITY b "c">]>{text}'
    return text.encode("utf-8", errors="replace")


# Containers of JSON and binary numbers: glTF and safetensors.


def _opened_gltf(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the header of a glTF or GLB file, and the chunks that follow it."""
    if data[:4] != b"glTF":
        return json.loads(data), b""
    end = 20 + int.from_bytes(data[12:16], "little")
    return json.loads(data[20:end]), data[end:]


def _closed_gltf(text: bytes, rest: bytes, *, binary: bool) -> bytes:
    if not binary:
        return text
    text += b" " * (-len(text) % 4)
    lengths = struct.pack("<III", 2, 20 + len(text) + len(rest), len(text))
    return b"glTF" + lengths + b"JSON" + text + rest


def change_gltf_header(data: bytes, chance: Random) -> bytes:
    """Change the header of a glTF or GLB file."""
    header, rest = _opened_gltf(data)
    change_tree(header, chance)
    return _closed_gltf(json_text(header), rest, binary=data[:4] == b"glTF")


_EMBEDDED = "data:application/octet-stream;base64,"


def change_gltf_buffers(data: bytes, chance: Random) -> bytes:
    """Replace words of the buffers of a glTF or GLB file, with its header whole."""
    header, rest = _opened_gltf(data)
    if data[:4] == b"glTF":
        rest = rest[:8] + replace_words(rest[8:], chance)
    for buffer in header["buffers"] if data[:4] != b"glTF" else ():
        plain = base64.b64decode(buffer["uri"].partition(",")[2])
        buffer["uri"] = _EMBEDDED + base64.b64encode(replace_words(plain, chance)).decode()
    return _closed_gltf(json_text(header), rest, binary=data[:4] == b"glTF")


_ITEM_SIZES = {"F64": 8, "F32": 4, "U32": 4}


def sealed(metadata: dict[str, Any], entries: dict[str, Any], body: bytes) -> bytes:
    """Return a safetensors file whose SHA-256 fits its content, whatever that is."""
    header = {"__metadata__": {**metadata, "sha256": "0" * 64}, **entries}
    first = dict(sorted(header["__metadata__"].items(), key=lambda item: item[0] != "sha256"))
    text = json_text({**header, "__metadata__": first})
    text += b" " * (-len(text) % 8)
    plain = len(text).to_bytes(8, "little") + text + body
    return plain.replace(b"0" * 64, hashlib.sha256(plain).hexdigest().encode(), 1)


def change_container(data: bytes, chance: Random) -> bytes:
    """Change metadata, tensors or the header of a sealed safetensors file, and seal it again."""
    end = 8 + int.from_bytes(data[:8], "little")
    entries = json.loads(data[8:end])
    metadata, blocks = entries.pop("__metadata__"), {}
    for name, entry in entries.items():
        blocks[name] = data[slice(*(end + offset for offset in entry["data_offsets"]))]
    for _ in range(chance.choice(FEW)):
        change = chance.randrange(12)
        if change < 6:
            tree = [json.loads(metadata["json"])] if change else [metadata]
            change_tree(tree, chance)
            text = json_text(tree[0] if tree else None).decode()
            metadata = {**metadata, "json": text} if change else _texts(tree)
            if "json" not in metadata or not _is_json(metadata["json"]):
                break
        elif entries:
            _change_tensor(entries, blocks, chance)
    offset = 0
    for name, entry in entries.items():
        entry["data_offsets"] = [offset, offset + len(blocks[name])]
        offset += len(blocks[name])
    if chance.random() < 0.1:
        change_tree(entries, chance)
    return sealed(metadata, entries, b"".join(blocks.values()))


def _texts(tree: list[Any]) -> dict[str, Any]:
    return tree[0] if tree and isinstance(tree[0], dict) else {"x": tree}


def _is_json(text: object) -> bool:
    try:
        json.loads(text)  # type: ignore[arg-type]
    except (TypeError, ValueError, RecursionError):
        return False
    return True


def _change_tensor(entries: dict[str, Any], blocks: dict[str, bytes], chance: Random) -> None:
    """Replace numbers of one tensor, all of them, its type or shape, or remove it."""
    name = chance.choice(sorted(entries))
    entry, size = entries[name], _ITEM_SIZES.get(entries[name]["dtype"], 1)
    change, shape = chance.randrange(8), entry["shape"]
    if change < 3 and blocks[name]:
        word = chance.choice([word for word in WORDS if len(word) == size] or [b"\0"])
        place = size * chance.randrange(len(blocks[name]) // size)
        blocks[name] = blocks[name][:place] + word + blocks[name][place + size :]
    elif change == 3:
        word = chance.choice([bytes(size), b"\xff" * size, *(w for w in WORDS if len(w) == size)])
        blocks[name] = word * (len(blocks[name]) // size)
    elif change == 4:
        entry["dtype"] = chance.choice(["F64", "F32", "U32", "I64", "BOOL", "BF16", "F8_E4M3", "x"])
    elif change == 5 and shape and 0 < shape[0] <= len(blocks[name]):
        rows = chance.randrange(shape[0])
        blocks[name] = blocks[name][: rows * (len(blocks[name]) // shape[0])]
        entry["shape"] = [rows, *shape[1:]]
    elif change == 6:
        entry["shape"] = chance.choice([shape[::-1], [*shape, 1], [-1], [2**40]])
    else:
        del entries[name], blocks[name]


# Chunks of sounds.


def change_chunks(data: bytes, chance: Random, *, order: str = "<") -> bytes:
    """Drop, repeat, exchange, rename or resize chunks of a RIFF or AIFF file, or change words."""
    chunks, position = [], 12
    while position + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}4sI", data, position)
        chunks.append((kind, size, data[position + 8 : position + 8 + size]))
        position += 8 + size + size % 2
    number = chance.randrange(len(chunks))
    kind, size, content = chunks[number]
    change = chance.randrange(8)
    if change < 4:
        small = min(range(len(chunks)), key=lambda place: (chance.random() < 0.3, place))
        number = chance.choice([number, small])
        kind, size, content = chunks[number]
        chunks[number] = kind, size, replace_words(content or b"\0", chance, near=40)
    elif change == 4:
        sizes = [0, 1, size - 1, size + 1, 2**31, 2**32 - 1]
        chunks[number] = kind, chance.choice(sizes) % 2**32, content
    elif change == 5:
        chunks[number : number + 1] = chance.choice([[], [chunks[number]] * 2])
    elif change == 6:
        chance.shuffle(chunks)
    else:
        other = chance.choice([b"data", b"fmt ", b"LIST", b"COMM", b"SSND", b"\0\0\0\0"])
        chunks[number] = other, size, content
    body = b"".join(
        struct.pack(f"{order}4sI", kind, size) + content + b"\0" * (len(content) % 2)
        for kind, size, content in chunks
    )
    return data[:4] + struct.pack(f"{order}I", (len(body) + 4) % 2**32) + data[8:12] + body


@cache
def _ogg_table() -> list[int]:
    table = []
    for byte in range(256):
        rest = byte << 24
        for _ in range(8):
            rest = (rest << 1 ^ (0x04C11DB7 if rest & 2**31 else 0)) % 2**32
        table.append(rest)
    return table


def change_ogg_pages(data: bytes, chance: Random) -> bytes:
    """Change a page of an Ogg file, and give it the checksum that fits."""
    starts = [match.start() for match in re.finditer(b"OggS\0", data)]
    number = chance.choice([0, chance.randrange(len(starts))])
    start, end = starts[number], [*starts, len(data)][number + 1]
    page = bytearray(replace_words(data[start:end], chance, near=60)[: end - start])
    page[:4], page[22:26] = b"OggS", bytes(4)
    rest = 0
    for byte in page:
        rest = (rest << 8 ^ _ogg_table()[rest >> 24 ^ byte]) % 2**32
    page[22:26] = rest.to_bytes(4, "little")
    return data[:start] + bytes(page) + data[end:]


def change_flac_blocks(data: bytes, chance: Random) -> bytes:
    """Change the header of a FLAC file: stream information, kinds and lengths of blocks."""
    head = 4 + 4 + 34
    changed = bytearray(data)
    for _ in range(chance.choice(FEW)):
        place = chance.choice([chance.randrange(4, head), chance.randrange(18, 26)])
        changed[place] = chance.choice([0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)])
    return bytes(changed)


# Archives.


def _members(data: bytes) -> list[tuple[str, bytes]]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return [(member.filename, archive.read(member)) for member in archive.infolist()]


def _zipped(members: Sequence[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    stream = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(stream, "w", method) as archive:
        warnings.simplefilter("ignore")  # names may be there twice
        for name, content in members:
            # A fixed date, so that the same members give the same bytes.
            member = zipfile.ZipInfo(name)
            member.compress_type = method
            archive.writestr(member, content)
    return stream.getvalue()


def change_members(data: bytes, chance: Random) -> bytes:
    """Change names, contents, methods, flags or sizes of the members of a zip file."""
    members = _members(data)
    number = chance.randrange(len(members))
    name, content = members[number]
    change = chance.randrange(6)
    if change == 0:
        names = ["../x.obj", "/x.obj", "C:x", "", "x.gz", "a/" * 50 + "x.obj", "__MACOSX/x.obj"]
        members[number] = chance.choice([*names, members[0][0]]), content
    elif change == 1:
        members[number] = name, chance.choice([flip_bits, truncate, repeat_block])(content, chance)
    elif change == 2:
        members[number : number + 1] = chance.choice([[], [(f"b{name}", content)] * 1])
    methods = [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
    packed = bytearray(_zipped(members, chance.choice(methods) if change == 3 else methods[1]))
    if change > 3:
        start = chance.choice([m.start() for m in re.finditer(b"PK\1\2|PK\3\4|PK\5\6", packed)])
        place = start + chance.choice([6, 8, 10, 16, 20, 24, 28, 30, 42])
        word = chance.choice([b"\1", b"\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x63\0"])
        packed[place : place + len(word)] = word
    return bytes(packed)


def change_arrays(data: bytes, chance: Random) -> bytes:
    """Change the header or the numbers of an array of an npz file, its name, or take it out."""
    members = _members(data)
    number = chance.randrange(len(members))
    name, content = members[number]
    change = chance.randrange(8)
    if change == 0:
        del members[number]
    elif change == 1:
        members[number] = chance.choice([*(n for n, _ in members), "x.npy", "x", "names"]), content
    elif change == 2:
        members[number] = name, members[chance.randrange(len(members))][1]
    elif change == 3:
        members[number] = name, _array_bytes(chance)
    elif change == 4:
        end = 10 + int.from_bytes(content[8:10], "little")
        members[number] = name, content[:end] + replace_words(content[end:] or b"\0", chance)
    else:
        end = 10 + int.from_bytes(content[8:10], "little")
        header = _change_array_header(content[10:end].decode("latin-1"), chance).encode("latin-1")
        members[number] = (
            name,
            content[:8] + struct.pack("<H", len(header)) + header + content[end:],
        )
    return _zipped(members)


def _array_bytes(chance: Random) -> bytes:
    arrays = (
        *(
            np.zeros((0, 3)),
            np.zeros(()),
            np.array(["x", "y"]),
            np.array([1j]),
            np.zeros((2, 3, 4)),
        ),
        *(np.array(["2020-01-01"], "M8[D]"), np.zeros(3, [("a", float)]), np.array([True])),
        *(np.full(3, np.nan), np.arange(3, dtype=">i2"), np.array([b"\xff"]), np.zeros(3, "f2")),
    )
    stream = io.BytesIO()
    np.save(stream, chance.choice(arrays), allow_pickle=False)
    return stream.getvalue()


def _change_array_header(text: str, chance: Random) -> str:
    shapes = ("(1000000000000,)", "(-1,)", "()", "(3, 3, 3)", "[3]", "(1e3,)", "(" * 200)
    types = ("|O", "<f2", ">f8", "|V8", "<U100000000", "<c16", "<M8[s]", "|b1", "x", "<i8")
    changes = (
        lambda: re.sub(r"'shape': \([^)]*\)", f"'shape': {chance.choice(shapes)}", text),
        lambda: re.sub(r"'descr': '[^']*'", f"'descr': '{chance.choice(types)}'", text),
        lambda: text.replace("False", chance.choice(["True", "1", "__import__('os')"])),
        lambda: text.replace("'shape'", "'shapes'"),
    )
    return chance.choice(changes)()


def _unzipped(data: bytes) -> bytes:
    return _members(data)[0][1]


# By ending: how content is packed and unpacked.
PACKINGS: dict[str, tuple[Callable[[bytes], bytes], Callable[[bytes], bytes]]] = {
    "gz": (partial(gzip.compress, mtime=0), gzip.decompress),
    "bz2": (bz2.compress, bz2.decompress),
    "xz": (lzma.compress, lzma.decompress),
    "zip": (lambda data: _zipped([("a.obj", data)]), _unzipped),
}


def change_packed(data: bytes, chance: Random, *, packing: str, change: Mutation) -> bytes:
    """Change the content of a packed file by `change`, or its packing."""
    pack, unpack = PACKINGS[packing]
    kind = chance.random()
    if kind < 0.3:
        return pack(change(unpack(data), chance))
    if kind < 0.4:
        return pack(data)
    if packing == "zip" and kind < 0.8:
        return change_members(data, chance)
    return chance.choice(IN_BINARY)(data, chance)


# HDF5.

_HDF5_TYPES = ("f4", "i8", "u1", "f2", "S4", "c16", "?")


def change_hdf5(data: bytes, chance: Random) -> bytes:
    """Change a variable or an attribute of an HDF5 file."""
    stream = io.BytesIO(data)
    with h5py.File(stream, "r+") as file:
        for _ in range(chance.choice(FEW)):
            # What HDF5 or NumPy refuses, as a link in a circle or text as a number, is no change.
            with contextlib.suppress(RuntimeError, ValueError, TypeError, OSError, MemoryError):
                _change_variable(file, chance.choice(sorted(file)), chance)
    return stream.getvalue()


def _change_variable(file: h5py.File, name: str, chance: Random) -> None:
    variable = file[name]
    holder = chance.choice([file, variable])
    change = chance.randrange(9)
    if change < 3 and holder.attrs:
        key = chance.choice(sorted(holder.attrs))
        values = [
            "",
            "x",
            "cartesian",
            "spherical",
            "metre",
            "\x1b[31m",
            5,
            [1.0, 2.0],
            b"\xff",
            "9" * 300,
        ]
        if change == 0:
            del holder.attrs[key]
        else:
            holder.attrs[key] = chance.choice(values)
        return
    if not isinstance(variable, h5py.Dataset):
        return
    if variable.size and variable.size >= 10**6:  # by an earlier change
        return
    values = variable[...] if variable.size else np.zeros(variable.shape)
    if change < 6:
        if values.size and values.dtype.kind in "fiu":
            flat = values.reshape(-1)
            number = chance.choice([np.nan, np.inf, -1.0, 0.0, 1e300, 1e-320, 7.0, 65536.0])
            with np.errstate(all="ignore"):
                flat[chance.choice([chance.randrange(flat.size), slice(None)])] = np.float64(
                    number
                ).astype(values.dtype)
        _replace(file, name, values)
    elif change == 6:
        shapes = [values[:1], values.reshape(-1), values.T, values[..., None], values[:0]]
        _replace(file, name, chance.choice(shapes) if values.ndim else values[None])
    elif change == 7:
        kind = chance.choice(_HDF5_TYPES)
        with np.errstate(all="ignore"):
            _replace(file, name, values.astype(kind))
    else:
        del file[name]
        chance.choice([_leave_out, _link, _group, _swell])(file, name)


def _replace(file: h5py.File, name: str, values: np.ndarray) -> None:
    """Put other values in place of a variable, with its type and units."""
    attributes = {key: value for key, value in file[name].attrs.items() if key in {"Type", "Units"}}
    del file[name]
    file[name] = values
    file[name].attrs.update(attributes)


def _leave_out(_file: h5py.File, _name: str) -> None:
    """Leave the variable out."""


def _link(file: h5py.File, name: str) -> None:
    file[name] = h5py.SoftLink(f"/{name}")


def _group(file: h5py.File, name: str) -> None:
    file.create_group(name)


def _swell(file: h5py.File, name: str) -> None:
    file.create_dataset(name, (10**6, 2, 10**6), chunks=(1, 2, 100), dtype=float)


ANYWHERE: list[Mutation] = [
    *(flip_bits, truncate, insert_bytes, delete_block, repeat_block, blank_block),
]
IN_TEXT: list[Mutation] = [
    *ANYWHERE,
    *[replace_numbers] * 6,
    *[move_lines] * 2,
    *(insert_odd_text, encode_otherwise),
]
IN_BINARY: list[Mutation] = [*ANYWHERE, *[replace_words] * 5]


def mutant(data: bytes, changes: Sequence[Mutation], chance: Random) -> bytes:
    """Return a file with a change of its structure, at times with changes anywhere after it."""
    changed = chance.choice(changes)(data, chance) or b" "
    while chance.random() < 0.1:
        changed = chance.choice(ANYWHERE)(changed, chance) or b" "
    return changed
