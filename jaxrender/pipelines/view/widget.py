"""The object of a page as a widget of a notebook (extra ``notebook``).

What a person chooses and what Python sets are traits, by the same names on both sides.
"""

from typing import Any

import anywidget
import numpy as np
import traitlets

from jaxrender.brdf import BRDF, Parametric
from jaxrender.pipelines.view.layout import Facts, values_of
from jaxrender.pipelines.view.material_table import with_amounts
from jaxrender.pipelines.view.page import markup_of, module_text
from jaxrender.pipelines.view.shown import Shown

# Lights that every viewer has beside those that it is given.
LIGHTS = ("result", "harmonics", "uniform", "dark")
_BASE64 = "data:image/png;base64,"


class _Numbers(traitlets.TraitType):
    """Finite numbers of one shape between two ends, kept as plain lists; perhaps None."""

    def __init__(
        self,
        shape: tuple[int, ...] = (),
        low: float = -np.inf,
        high: float = np.inf,
        optional: bool = False,
    ):
        super().__init__(None)
        self.shape, self.low, self.high, self.optional = shape, low, high, optional
        self.tag(sync=True)

    def validate(self, obj: Any, value: Any) -> Any:
        """Refuse other shapes, and numbers beyond the ends, with ``ValueError``."""
        if value is None and self.optional:
            return None
        low, high = obj.ends.get(self.name, (self.low, self.high))
        try:
            numbers = np.asarray(value, float)
        except (TypeError, ValueError):
            numbers = np.array(np.nan)
        inside = np.isfinite(numbers) & (numbers >= low) & (numbers <= high)
        if numbers.shape != self.shape or not inside.all():
            what = f"an array of shape {self.shape}" if self.shape else "a number"
            span = f" from {low:.4g} to {high:.4g}" if np.isfinite([low, high]).any() else ""
            raise ValueError(f"{self.name}={value!r}: give {what}{span}, all finite")
        return numbers.tolist()


class Viewer(anywidget.AnyWidget):
    """An object in a notebook, to turn and to light; it draws what the page of ``view`` draws.

    ``light`` is the name of one of ``lights``.  ``base`` and ``lobe`` are the amounts of the
    material's base and of its lobes, by channel; of maps of metal the mean base colour, and the
    mean metalness for each channel.  ``roughness`` is the model's own number, None
    where it has none.  ``azimuth``, ``elevation`` (degrees) and ``zoom`` are the camera's;
    ``stops`` is the exposure over that of the first picture.  ``lamp`` is None, or azimuth and
    elevation (degrees) and strength of a lamp; ``turn`` a rotation of the light [3, 3];
    ``coefficients`` are those of the light "harmonics" [9, 3] (T 4.3.3).  ``shown`` names a map of
    a texture, or "picture".

    Setting them changes the picture, and they tell what a person chose.  Raises ``ValueError`` for
    values that cannot be shown.
    """

    _esm = module_text()
    _scene = traitlets.Dict().tag(sync=True)
    _markup = traitlets.Unicode().tag(sync=True)
    light = traitlets.Unicode("result").tag(sync=True)
    shown = traitlets.Unicode("picture").tag(sync=True)
    base = _Numbers((3,), low=0.0)
    lobe = _Numbers((3,), low=0.0)
    roughness = _Numbers(optional=True)
    azimuth = _Numbers()
    elevation = _Numbers(low=-89.0, high=89.0)
    zoom = _Numbers(low=0.3, high=8.0)
    stops = _Numbers(low=-6.0, high=6.0)
    lamp = _Numbers((3,), optional=True)
    turn = _Numbers((3, 3), low=-1.0, high=1.0)
    coefficients = _Numbers((9, 3))

    def __init__(self, shown: Shown, facts: Facts):
        values = values_of(shown, facts)
        scene, self._what, self._still = values["scene"], shown, values["still"]
        self.lights = (*LIGHTS[:1], *shown.others, *LIGHTS[1:])
        self.maps = ("picture",) if shown.texture is None else tuple(shown.texture.choices)
        width = next((one for one in values["sliders"] if one.part == "width"), None)
        self.ends = {} if width is None else {"roughness": (width.lowest, width.highest)}
        azimuth, elevation = np.degrees(scene["view"])
        super().__init__(
            _scene=scene,
            _markup=markup_of(values),
            base=shown.table.base,
            lobe=shown.table.lobe,
            roughness=None if width is None else width.value,
            azimuth=azimuth,
            elevation=elevation,
            zoom=1.0,
            stops=0.0,
            turn=np.eye(3),
            coefficients=shown.light.coefficients,
        )

    @traitlets.validate("light", "shown")
    def _known(self, proposal: Any) -> str:
        name, value = proposal["trait"].name, proposal["value"]
        names = self.lights if name == "light" else self.maps
        if value not in names:
            raise ValueError(f"{name}={value!r}: choose one of {', '.join(names)}")
        return value

    @traitlets.validate("roughness")
    def _own(self, proposal: Any) -> float | None:
        value = proposal["value"]
        if (value is None) is ("roughness" in self.ends):
            raise ValueError(
                f"roughness={value}: give a number"
                if value is None
                else f"roughness={value}: a {type(self._what.brdf).__name__} has no roughness"
            )
        return value

    @traitlets.validate("lamp")
    def _shining(self, proposal: Any) -> list[float] | None:
        lamp = proposal["value"]
        if lamp is not None and lamp[2] < 0:
            raise ValueError(f"lamp={lamp}: give a strength, the third number, from 0")
        return lamp

    @traitlets.validate("turn")
    def _rotation(self, proposal: Any) -> list[list[float]]:
        matrix = np.array(proposal["value"])
        if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-5) or np.linalg.det(matrix) < 0:
            raise ValueError(f"turn={proposal['value']}: give the matrix of a rotation")
        return proposal["value"]

    @property
    def brdf(self) -> BRDF:
        """The material as it was chosen, of a texture that of the mean texel.

        Raises ``ValueError`` for a material that has no amplitudes of its own to choose.
        """
        brdf = self._what.brdf
        if not isinstance(brdf, Parametric):
            raise ValueError(f"a {type(brdf).__name__} has no numbers to choose")
        if self.roughness is not None:
            brdf = brdf.with_numbers({brdf.shape.name: np.asarray(self.roughness)})
        table = self._what.table
        return with_amounts(brdf, table, np.array(self.base), np.array(self.lobe))

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        """Add a still picture, for readers that run no widgets."""
        data, about = super()._repr_mimebundle_(**kwargs) or ({}, {})
        return {**data, "image/png": self._still.removeprefix(_BASE64)}, about
