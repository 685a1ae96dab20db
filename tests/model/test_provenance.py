"""What a person sees of long work."""

from __future__ import annotations

import io

import pytest

from struck.model.provenance import FORECAST, TerminalProgress


class Terminal(io.StringIO):
    """A text stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def last_line(told: str) -> str:
    return told.rsplit("\x1b[K", 1)[-1]


def test_stage_share_and_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal, now = Terminal(), [100.0]
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    progress = TerminalProgress()
    progress("mesh", 0.0)
    assert last_line(terminal.getvalue()) == "mesh"
    progress("iterate", 0.0)
    now[0] += 10.0
    progress("iterate", 0.25)
    assert last_line(terminal.getvalue()) == "iterate  25 %, about 30 s left"
    progress("iterate", 1.0)
    assert last_line(terminal.getvalue()) == "iterate 100 %"
    progress.close()
    assert last_line(terminal.getvalue()) == ""


def test_a_log_gets_nothing_of_short_work(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    progress = TerminalProgress()
    progress("mesh", 0.5)
    progress.close()
    assert stream.getvalue() == ""


def test_a_forecast_stays_to_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    progress = TerminalProgress()
    progress(f"{FORECAST}about 200 modes", 0.0)
    progress("iterate", 0.0)
    assert terminal.getvalue().endswith("\r\x1b[Kforecast: about 200 modes\n\r\x1b[Kiterate")
