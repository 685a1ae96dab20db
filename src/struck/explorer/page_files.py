"""Files for the page: models as fine as its clicks need, and the tables of heads.

The page knows some mode shapes by their formula and goes straight from vertex to vertex in all
others; heads come as delays and responses over directions, ready to be mixed.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from struck.ears import heads, measured_head
from struck.ears.sphere import HEAD_RADIUS
from struck.errors import require_choice, rounded
from struck.files.container import Arrays, pack
from struck.files.model_file import to_bytes
from struck.model.gains import ShapeGains
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.perception.audibility import audible
from struck.shapes.particular_solutions import PolygonForms

# Bytes of the shapes at the vertices of a refined body, which the page has no formula for.
MAX_SHAPE_BYTES = 32 * 2**20
MAX_SENT_BYTES = 256 * 2**20  # bytes of shapes that a page takes at all
_BLOCK_POINTS = 4096  # places looked up together
FINE_RATIO = 0.28  # spacing times wave number up to which straight lines miss a wave by 1 %


def model_bytes(model: ModalModel) -> bytes:
    """Return a model as the page reads it: fine enough to be clicked on, and at most 256 MB."""
    page_model = thin_model(refined(model))
    gains = page_model.gains
    # The page's listener has one gain a mode.
    return to_bytes(replace(page_model, gains=getattr(gains, "averaged", gains)))


def refined(model: ModalModel) -> ModalModel:
    """Return a body whose formula the page does not have on a finer mesh, at most 32 MB of it.

    All edges are halved until straight lines between vertices are 1 % true of all modes. Other
    bodies are returned as they are.
    """
    gains = model.gains
    if not isinstance(gains, ShapeGains) or gains.formula is None:
        return model
    forms, surface = gains.formula.forms, gains.surface
    if not isinstance(forms, PolygonForms):
        return model
    max_edge = FINE_RATIO * gains.formula.size / forms.wavenumbers.max(initial=0.0)
    # A closed surface of V vertices has about 3 V edges: halved, each makes one more.
    max_vertices = MAX_SHAPE_BYTES // (4 * 3 * 4 * len(forms.wavenumbers))
    while len(surface.points) <= max_vertices and _longest_edge(surface) > max_edge:
        surface = _halve_edges(surface)
    if surface is gains.surface:
        return model
    shapes = gains.formula.displacements(surface.points).astype(np.float32)
    return replace(
        model,
        gains=replace(gains, surface=surface, shapes=shapes),
        geometry=None if model.geometry is None else surface,
    )


def thin_model(model: ModalModel, max_bytes: int = MAX_SENT_BYTES) -> ModalModel:
    """Return a body of at most some bytes of shapes: audible modes, then fewer vertices.

    Its provenance lists omissions. Smaller bodies are returned as they are.
    """
    if not isinstance(model.gains, ShapeGains) or model.gains.shapes.nbytes <= max_bytes:
        return model
    model = audible(model)
    gains = model.gains
    if not isinstance(gains, ShapeGains) or gains.shapes.nbytes <= max_bytes:
        return model
    import igl

    original_surface = gains.surface
    # A closed surface has twice as many faces as vertices.
    face_count = 2 * max_bytes // (12 * len(model.frequencies))
    triangles = np.asfortranarray(original_surface.faces.astype(np.int32))
    points, faces = igl.qslim(np.asfortranarray(original_surface.points), triangles, face_count)[:2]
    surface = Mesh(
        points=np.ascontiguousarray(points), faces=np.array(faces), up=original_surface.up
    )
    parts = [
        gains.shapes_at(surface.points[first : first + _BLOCK_POINTS]).astype(np.float32)
        for first in range(0, len(surface.points), _BLOCK_POINTS)
    ]
    note = (
        f"{len(original_surface.points) - len(surface.points)} of {len(original_surface.points)} "
        f"vertices were left out, so that {len(model.frequencies)} modes take "
        f"{rounded(max_bytes / 2**20)} MB"
    )
    return replace(
        model,
        gains=replace(gains, surface=surface, shapes=np.concatenate(parts)),
        geometry=None if model.geometry is None else surface,
        provenance=model.provenance.extended(dropped=(note,)),
    )


def _longest_edge(surface: Mesh) -> float:
    corners = surface.points[surface.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())


def _halve_edges(surface: Mesh) -> Mesh:
    """Return a surface with four faces for each."""
    from trimesh.remesh import subdivide

    points, faces = subdivide(surface.points, surface.faces)[:2]
    return Mesh(points=points, faces=faces, up=surface.up)


def head_bytes(name: str, sample_rate: int) -> bytes:
    """Return the tables of a head's delays, s, and responses: "kemar" or "exact", a rigid ball.

    A container of the format "struck-head"; `static/sound/head.js` reads it. Making it takes about
    a second, once.

    Raises
    ------
    OptionError
        On another name, or a sample rate that no head has.
    """
    require_choice("head", name, HEAD_MAKERS)
    text, tables = HEAD_MAKERS[name](sample_rate)
    return pack(tables, {"format": "struck-head", "version": "1", "json": json.dumps(text)})


def _tabulate_measured(sample_rate: int) -> tuple[dict[str, object], Arrays]:
    """Return the grids of a measured head, far and near, as responses in place of their spectra."""
    head = measured_head.MeasuredHead.named("kemar")
    filters = head.prepared(sample_rate, brief=True)
    if not isinstance(filters, measured_head.MeasuredFilters):
        raise TypeError(f"KEMAR's filters are {type(filters).__name__}")
    tables: Arrays = {}
    near_taps = round(measured_head.NEAR_LASTING * sample_rate)
    for kind, table, taps in (
        ("far", filters.grid, filters.taps),
        ("near", filters.near, near_taps),
    ):
        spectra = np.ascontiguousarray(table[:, 2:]).view(np.complex64).reshape(len(table), 2, -1)
        responses = np.fft.irfft(spectra, filters.length)[..., :taps]
        tables[f"{kind}_delays"] = np.ascontiguousarray(table[:, :2])
        tables[f"{kind}_responses"] = responses.astype(np.float32)
    text = {
        "kind": "measured",
        "columns": len(measured_head.AZIMUTHS),
        "near_columns": measured_head.NEAR_STEPS + 4,
        "step": measured_head.STEP,
        "near_steps": measured_head.NEAR_STEPS,
        "near": heads.NEAR,
        "knot_step": heads.KNOT_STEP,
        "farthest": float(1 + heads.HEIGHTS[-3]),
        "radius": HEAD_RADIUS,
        "source": head.measured.source,
        "licence": head.measured.licence,
    }
    return text, tables


def _ball(sample_rate: int) -> tuple[dict[str, object], Arrays]:
    """Return the table of a rigid ball over angles and distances."""
    filters = heads.SphereHead().prepared(sample_rate)
    if not isinstance(filters, heads.TabulatedFilters):
        raise TypeError(f"a ball's filters are {type(filters).__name__}, not TabulatedFilters")
    text = {
        "kind": "ball",
        "steps": heads.STEPS,
        "near": heads.NEAR,
        "knots": heads.KNOTS,
        "knot_step": heads.KNOT_STEP,
        "radius": filters.radius,
        "ears": filters.ears.T.tolist(),
    }
    responses = np.ascontiguousarray(filters.table[:, 1:], np.float32)
    return text, {"delays": np.ascontiguousarray(filters.table[:, 0]), "responses": responses}


HEAD_MAKERS = {"kemar": _tabulate_measured, "exact": _ball}
