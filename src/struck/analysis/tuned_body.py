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
    """Find the dimension of a body for which one of its modes has a given frequency.

    Parameters
    ----------
    body : body of struck.solids or struck.shapes, or callable
        The body, or a function that makes it and whose arguments are varied, such as
        ``functools.partial(bowl, radius=0.1)``. A file has no dimensions to vary.
    material : Material or str
        The material.
    vary : str
        Name of the dimension, such as "length".
    lowest : float or str, optional
        Frequency of the lowest mode, Hz, or a note such as "A5" or "A5+12c".
    **options
        `frequency` and `mode` for another mode, `accuracy` and `progress`, as for
        `struck.analysis.tune`.

    Returns
    -------
    solid or shape
        A copy of the body with the new dimension.

    Raises
    ------
    OptionError
        If the body has no such dimension, or it does not reach the frequency.

    Examples
    --------
    >>> from struck.shapes import Bar
    >>> bar = Bar(length=0.3, width=0.03, thickness=0.005)
    >>> tuned = struck.tune(bar, "rosewood", vary="length", lowest="A4", progress=None)
    >>> round(tuned.length, 4)
    0.2151
    >>> struck.analyze(tuned, "rosewood", progress=None).frequencies[:1].round(1)
    array([440.])
    """
    return tuning.tune(body, material, vary=vary, lowest=lowest, **options).body
