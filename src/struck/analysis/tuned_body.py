"""The verb `tune`: a body whose mode is in tune, without the account that `analysis.tune` gives."""

from __future__ import annotations

from typing import Any

from struck.analysis import tuning
from struck.analysis.source_options import Source
from struck.model.arrays import checked
from struck.model.material import Material


@checked
def tune(
    body: Source,
    material: Material | str,
    *,
    vary: str,
    lowest: float | str | None = None,
    **options: Any,  # noqa: ANN401 - of `struck.analysis.tuning`
) -> Any:  # noqa: ANN401 - as the body
    """Return the body with the dimension that makes its lowest mode, or another, ring in tune.

    Parameters
    ----------
    body : a body of struck.solids or struck.shapes, or ``functools.partial(bowl, radius=0.1)``
        A file has no dimensions to vary.
    material : Material or str
    vary : str
        Name of the dimension, such as "length".
    lowest : float
        Hz, or a note as "A5" or "A5+12c".
    **options
        Of other modes ``frequency=, mode="bending 2"``, and more, as of `struck.analysis.tune`.

    Raises
    ------
    OptionError
        When the body has no such dimension, or it does not reach the frequency.
    """
    return tuning.tune(body, material, vary=vary, lowest=lowest, **options).body
