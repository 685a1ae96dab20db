"""The server: who is let in, what it serves, and what it never does."""

from __future__ import annotations

import hashlib
import http.client
import socket
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest

import struck
from struck.cli import main
from struck.errors import OptionError
from struck.explorer import server
from struck.explorer.admission import LARGEST_BODY
from struck.explorer.facts import number_places
from struck.explorer.server import STATIC, Explorer
from struck.shapes import Bar
from tests.explorer.served import Client


@pytest.fixture(scope="module")
def bar() -> struck.ModalModel:
    body = Bar(length=0.3, width=0.03, thickness=0.005, ends="free")
    return struck.analyze(body, "steel", damping="heard")


@pytest.fixture(scope="module")
def explorer(bar: struck.ModalModel) -> Iterator[Explorer]:
    with Explorer(given=[bar], names=["bar"]) as opened:
        yield opened


@pytest.fixture
def client(explorer: Explorer) -> Client:
    client = Client(explorer.url)
    client.enter()
    return client


def test_token_becomes_a_cookie_and_leaves_the_address(explorer: Explorer) -> None:
    client = Client(explorer.url)
    entered = client.enter()
    assert (entered.status, entered.headers["location"]) == (303, "/")
    cookie = entered.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    assert client.ask("GET", "/").status == 200


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_step_from_a_file_is_a_page_of_the_server(explorer: Explorer, site: str) -> None:
    """A browser sends no strict cookie along a redirect that begins elsewhere."""
    client = Client(explorer.url)
    answer = client.ask("GET", client.path, sec_fetch_site=site)
    assert answer.status == 200
    assert b'content="0;url=/"' in answer.body
    assert "samesite=strict" in answer.headers["set-cookie"].lower()
    assert answer.headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize(
    ("path", "cookie", "status"),
    [
        ("/", None, 403),
        ("/?token=", None, 403),
        ("/?token=" + "a" * 32, None, 403),
        ("/api/room", None, 403),
        ("/static/main.js", None, 403),
        ("/models/given_1.struck", "struck_1=x", 403),
        ("/", "struck_{port}=wrong", 403),
        ("/", "\x7f=;;;", 403),
    ],
)
def test_without_the_token_nothing_is_served(
    explorer: Explorer, path: str, cookie: str | None, status: int
) -> None:
    client = Client(explorer.url)
    answer = client.ask("GET", path, cookie=cookie and cookie.format(port=client.port))
    assert answer.status == status
    assert b"token" in answer.body


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "", None])
def test_foreign_hosts_are_refused(client: Client, host: str | None) -> None:
    answer = client.ask("GET", "/api/room", host=host)
    assert answer.status == 400


def test_this_machine_by_its_name_is_no_foreign_host(client: Client) -> None:
    assert client.ask("GET", "/api/room", host=f"localhost:{client.port}").status == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", None])
def test_foreign_origins_may_not_post(client: Client, origin: str | None) -> None:
    answer = client.ask("POST", "/api/models/given_1/change", {}, origin=origin)
    assert answer.status == 403
    assert client.ask("GET", "/api/room", origin="http://evil.example").status == 403


@pytest.mark.parametrize(
    "path",
    [
        "/static/../server.py",
        "/static/%2e%2e/server.py",
        "/static/..%2fserver.py",
        "/static//etc/passwd",
        "/static/",
        "/models/..%2f..%2fetc%2fpasswd.struck",
        "/models/given_2.struck",
        "/models/given_1.page",
        "/docs",
    ],
)
def test_no_file_beyond_the_page_and_the_models_is_served(client: Client, path: str) -> None:
    assert client.ask("GET", path).status in {404, 405}


def test_every_answer_isolates_the_page(client: Client) -> None:
    for path in ("/", "/static/main.js", "/api/room", "/nothing"):
        sent = client.ask("GET", path).headers
        assert sent["cross-origin-opener-policy"] == "same-origin"
        assert sent["cross-origin-embedder-policy"] == "require-corp"
        assert sent["x-content-type-options"] == "nosniff"
        assert sent["referrer-policy"] == "no-referrer"
        policy = sent["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "'unsafe-inline'" not in policy
        assert "'wasm-unsafe-eval'" in policy


def test_kinds_of_files_are_said(client: Client) -> None:
    for path, kind in (
        ("/", "text/html"),
        ("/static/main.js", "text/javascript"),
        ("/static/style.css", "text/css"),
        ("/static/core.wasm", "application/wasm"),
        ("/models/given_1.struck", "application/octet-stream"),
    ):
        answer = client.ask("GET", path)
        assert answer.status == 200, path
        assert answer.headers["content-type"].startswith(kind)


def test_large_bodies_are_refused_with_and_without_a_length(client: Client) -> None:
    path = "/api/models/given_1/change"
    assert client.ask("POST", path, b" " * (LARGEST_BODY + 1)).status == 413
    connection = http.client.HTTPConnection("127.0.0.1", client.port, timeout=20)
    sent = {"Origin": client.origin, "Cookie": client.cookie}
    chunks = iter([b" " * 4096] * (LARGEST_BODY // 4096 + 2))
    connection.request("POST", path, chunks, sent, encode_chunked=True)
    assert connection.getresponse().status == 413
    connection.close()


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        (b"{", "JSON"),
        (b"[]", "JSON"),
        ({"size": 100}, "0.1 to 10"),
        ({"size": "big"}, "0.1 to 10"),
        ({"damping": -1}, "0 to 1000"),
        ({"material": "unobtainium"}, "unobtainium"),
        ({"material": 3}, "material"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_bad_changes_get_a_sentence(client: Client, wanted: object, said: str) -> None:
    answer = client.ask("POST", "/api/models/given_1/change", wanted)
    assert answer.status == 400
    assert said in answer.json["message"]


def test_page_gets_what_a_change_does(client: Client, bar: struck.ModalModel) -> None:
    wanted = {"material": "glass", "size": 1.5, "damping": 2.0}
    told = client.ask("POST", "/api/models/given_1/change", wanted).json
    truth = bar.made_of(struck.Material.named("glass", "heard")).scaled(1.5)
    law = truth.material.damping
    truth = truth.damped(replace(law, mass=2 * law.mass, stiffness=2 * law.stiffness))
    assert told["modes"] is None
    np.testing.assert_allclose(told["frequencies"], truth.frequencies, rtol=1e-12)
    np.testing.assert_allclose(told["decays"], truth.decays, rtol=1e-12)
    pairs = np.array(told["outputs"])
    np.testing.assert_allclose(pairs[:, 0] + 1j * pairs[:, 1], truth.gains.outputs, rtol=1e-6)
    shapes = told["factor"] * bar.gains.shapes.astype(float)
    np.testing.assert_allclose(shapes, truth.gains.shapes, rtol=1e-5, atol=1e-6)
    assert told["mass"] == pytest.approx(truth.mass)


@pytest.mark.parametrize("wanted", [{"size": 0.7}, {"damping": 3.0}])
def test_size_and_damping_need_no_second_answer(
    client: Client, bar: struck.ModalModel, wanted: dict[str, float]
) -> None:
    told = client.ask("POST", "/api/models/given_1/change", {**wanted, "quick": True}).json
    truth = bar.scaled(wanted.get("size", 1.0))
    assert told["settled"]
    pairs = np.array(told["outputs"])
    np.testing.assert_allclose(pairs[:, 0] + 1j * pairs[:, 1], truth.gains.outputs, rtol=1e-6)


def test_another_material_is_answered_at_once_and_then_in_full(client: Client) -> None:
    path = "/api/models/given_1/change"
    quick = client.ask("POST", path, {"material": "glass", "quick": True}).json
    whole = client.ask("POST", path, {"material": "glass"}).json
    assert (quick["settled"], whole["settled"]) == (False, True)
    assert quick["frequencies"] == whole["frequencies"]
    assert quick["decays"] == whole["decays"]
    levels = np.abs(np.array(quick["outputs"])[:, 0] / np.array(whole["outputs"])[:, 0])
    assert 0.3 < levels.min() <= levels.max() < 3.0


def test_page_gets_the_drive_of_a_contact(client: Client, bar: struck.ModalModel) -> None:
    contact = bar.contact("end")
    told = client.ask("POST", "/api/models/given_1/drive", {"point": contact.point.tolist()}).json
    truth = bar.gains.at(contact.point[None], contact.direction[None])[0, 0]
    np.testing.assert_allclose(told["drive"], truth, rtol=1e-12)
    off = client.ask("POST", "/api/models/given_1/drive", {"point": [9, 9, 9]})
    assert off.status == 400
    assert "off the body" in off.json["message"]


def test_model_comes_as_its_file(client: Client, bar: struck.ModalModel, tmp_path: Path) -> None:
    path = tmp_path / "bar.struck"
    path.write_bytes(client.ask("GET", "/models/given_1.struck").body)
    np.testing.assert_array_equal(struck.load(path).frequencies, bar.frequencies)


def test_vendored_files_are_those_of_their_packages() -> None:
    import json

    folder = STATIC / "vendor"
    listed = set()
    for package in json.loads((folder / "vendor.json").read_text(encoding="utf-8")):
        assert package["licence"] == "MIT"
        for file in package["files"]:
            content = (folder / file["path"]).read_bytes()
            assert hashlib.sha256(content).hexdigest() == file["sha256"], file["path"]
            listed.add(file["path"])
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert there == listed | {"vendor.json"}


def test_own_scripts_are_short() -> None:
    own = [path for path in STATIC.rglob("*.js") if "vendor" not in path.parts]
    sizes = {path.name: len(path.read_text(encoding="utf-8").splitlines()) for path in own}
    assert len(own) > 10
    assert not {name: lines for name, lines in sizes.items() if lines > 500}


def test_taken_port_and_missing_file_are_errors_in_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["explore", "--port", str(port), "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"port {port}" in said
    assert main(["explore", "missing.struck", "--no-browser"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_without_its_libraries_the_install_line_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert main(["explore", "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "pip install 'struck[explorer]'" in said


def test_names_and_models_are_as_many(bar: struck.ModalModel) -> None:
    with pytest.raises(OptionError, match="2 names for 1 models"):
        struck.explore(bar, names=["a", "b"], browser=False)
    with pytest.raises(OptionError, match="objects is empty"):
        struck.explore(objects=[], browser=False)
    with pytest.raises(OptionError, match="did you mean bell"):
        struck.explore(objects=["bel"], browser=False)
    with pytest.raises(OptionError, match="objects of the room too"):
        struck.explore(bar, objects=["bell"], browser=False)
    with pytest.raises(OptionError, match="65535"):
        struck.explore(bar, port=70_000, browser=False)
    with pytest.raises(OptionError, match="model"):
        struck.explore("bar.struck", browser=False)


def test_browser_opens_where_there_is_a_display(
    bar: struck.ModalModel, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(server.webbrowser, "open", lambda url: opened.append(url) or True)
    monkeypatch.setattr(server, "has_display", lambda: True)
    with struck.explore(bar, wait=False) as explorer:
        (page,) = opened
        assert explorer.url.partition("=")[2] not in page
        assert explorer.url in Path(unquote(urlsplit(page).path)).read_text()
        assert explorer.url in capsys.readouterr().err
        assert explorer.open_in_browser()  # as one does who has closed the page
        assert opened == [page, page]
    with pytest.raises(OptionError, match="the room is closed"):
        explorer.open_in_browser()


@pytest.mark.prove
def test_a_place_without_a_name_is_numbered_as_others_are(bar: struck.ModalModel) -> None:
    assert bar.geometry is not None
    nameless = replace(bar, places={"": bar.geometry.points[0]}, playing_place=None)
    assert [place["name"] for place in number_places(nameless)][1] == ""
