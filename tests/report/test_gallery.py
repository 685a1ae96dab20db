"""The recording of the gallery."""

from __future__ import annotations

from pathlib import Path

import struck
from struck.report.gallery import NAME, recording


def test_a_recorded_drum_becomes_a_model_and_a_page(tmp_path: Path) -> None:
    page = recording(tmp_path, lambda _stage, _share: None)
    model = struck.load(tmp_path / f"{NAME}.struck")
    assert page.startswith("<!doctype html>")
    assert len(model.frequencies) <= 64
    assert model.provenance.details["signal_to_residual"] > 25
    for name in ("half", "recorded", "twice"):
        assert struck.Sound.load(tmp_path / f"{NAME}_{name}.wav").peak > 0
