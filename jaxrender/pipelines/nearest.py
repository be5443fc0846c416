"""The models nearest to a BRDF from any source: a table of them, as data and as a picture.

Scattered measurements are fitted to as they are; of all else pairs of directions are evaluated.
"""

from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from jaxrender.brdf import BRDF
from jaxrender.brdf.tables.isotropic import HalfDifference, half_difference, pair_at
from jaxrender.brdf.tables.measurements import METRICS, Measurements
from jaxrender.errors import InputError
from jaxrender.geometry import Components
from jaxrender.inverse.nearest_models import CANDIDATES, KNOWN, Candidate, best_models, pairs_of
from jaxrender.io.atomic import replacing
from jaxrender.pipelines.brdf_sources import measurements_of, source_of
from jaxrender.pipelines.progress import Progress, SilentProgress
from jaxrender.pipelines.result import write_json
from jaxrender.shapes import Float

DATA, PICTURE = "nearest.json", "nearest.png"
_SLICE = 90
_DRAWN = 3
_evaluate = eqx.filter_jit(BRDF.evaluate)


class Nearest(NamedTuple):
    """The candidates, the best first, and sentences about them."""

    candidates: tuple[Candidate, ...]
    said: tuple[str, ...]


def nearest(
    named: str,
    metric: str = "cube-root",
    models: tuple[str, ...] = (),
    out: Path | None = None,
    progress: Progress | None = None,
) -> Nearest:
    """Fit models to a source of ``brdf_sources`` and rank them; write data and picture to ``out``.

    Raises ``InputError`` for an unreadable source, an unknown model, values that nothing can be
    near to, and a folder that cannot be made.
    """
    for name in models:
        if name not in KNOWN:
            raise InputError(f"--model {name}: choose of {', '.join(KNOWN)}")
    progress = progress or SilentProgress()
    brdf, whole = None, "scattered measurements"
    with progress.stage("read"):
        measured = measurements_of(named)
    try:
        if measured is None:
            brdf = source_of(named).brdf
            measured, whole = pairs_of(brdf), "pairs of directions"
        folds = 0 if brdf is not None else None
        with progress.stage("fit models"):
            found = best_models(measured, models or CANDIDATES, metric=metric, folds=folds)
    except ValueError as error:
        raise InputError(f"{named}: {error}") from None
    said = [f"{named}: {len(measured.values)} {whole}; {METRICS[metric].meaning}"]
    said += _table(found, metric)
    if out is not None:
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{out}: cannot be made ({error.strerror}); name a folder") from None
        with replacing(out / DATA) as aside:
            write_json(aside, {"source": named, "metric": metric, "models": _data(found)})
        with replacing(out / PICTURE) as aside:
            _draw(aside, found, measured, brdf)
        said.append(f"data: {out / DATA}; picture: {out / PICTURE}")
    return Nearest(tuple(found), tuple(said))


def _table(found: list[Candidate], metric: str) -> list[str]:
    names = [metric, *(name for name in METRICS if name != metric)]
    held = not np.isnan(found[0].held_out)
    head = ["model", *(["held out"] if held else []), *names]
    rows = []
    for one in found:
        shares = [*([one.held_out] if held else []), *(one.errors[name] for name in names)]
        rows.append([one.name, *(f"{100 * share:.1f} %" for share in shares)])
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]
    lines = ["  ".join(w.ljust(n) for w, n in zip(row, widths)).rstrip() for row in [head, *rows]]
    for one in found:
        lines.append(f"{one.name}: {_numbers(one)}" + ("" if one.converged else "; not converged"))
    return lines


def _numbers(one: Candidate) -> str:
    def written(value: float, error: float) -> str:
        return f"{value:.4g}" + (f" ± {error:.1g}" if np.isfinite(error) else " (not told)")

    parts = []
    for name, value in one.parameters.items():
        pairs = zip(np.atleast_1d(value), np.atleast_1d(one.standard_errors[name]), strict=True)
        parts.append(f"{name} " + " / ".join(written(float(a), float(b)) for a, b in pairs))
    return ", ".join(parts)


def _data(found: list[Candidate]) -> list[dict[str, Any]]:
    """Write what is not finite as null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: plain(one) for name, one in value.items()}
        if isinstance(value, (list, tuple)):
            return [plain(one) for one in value]
        return None if isinstance(value, float) and not np.isfinite(value) else value

    return [
        plain({k: v for k, v in one._asdict().items() if k not in ("brdf", "relative_rms")})
        for one in found
    ]


def _draw(path: Path, found: list[Candidate], measured: Measurements, brdf: BRDF | None) -> None:
    from matplotlib.figure import Figure

    pair = Components.of(measured.incoming), Components.of(measured.outgoing)
    tilt, apart = (np.degrees(np.asarray(angle)) for angle in half_difference(*pair)[:2])
    channel = measured.values.shape[1] // 2
    values = np.where(measured.valid, measured.values, np.nan)[:, channel]
    drawing = Figure(figsize=(13, 4), layout="constrained")
    lobe, image, error = drawing.subplots(1, 3)
    lobe.plot(tilt, values, ".", color="0.6", markersize=3, label="the values")
    at = measured.incoming, measured.outgoing
    ours = [np.asarray(_evaluate(one.brdf, *at))[:, channel] for one in found[:_DRAWN]]
    for one, predicted in zip(found, ours):
        lobe.plot(tilt, predicted, ".", markersize=2, label=one.name)
    positive = values[values > 0]
    lobe.set(
        yscale="log",
        ylim=(positive.min() / 2, 2 * positive.max()),
        xlabel="angle of the half vector [degrees]",
        ylabel=f"BRDF [1/sr], channel {channel}",
        title="lobe",
    )
    lobe.legend(fontsize=7)
    shown = found[0].brdf if brdf is None else brdf
    image.imshow(_slice(shown), origin="lower", extent=(0, 90, 0, 90), aspect="auto")
    image.set(
        title=f"slice of {found[0].name if brdf is None else 'the BRDF'}, cube root",
        xlabel="half angle [degrees]",
        ylabel="difference angle [degrees]",
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = ours[0] / values
    dots = error.scatter(tilt, ratio, c=apart, s=4)
    error.axhline(1, color="k", linewidth=0.8)
    error.set(
        yscale="log",
        ylim=(1 / 8, 8),
        title=f"{found[0].name} over the values",
        xlabel="angle of the half vector [degrees]",
    )
    drawing.colorbar(dots, ax=error, label="difference angle [degrees]")
    drawing.savefig(path, dpi=100)


def _slice(brdf: BRDF) -> Float[np.ndarray, "theta_d theta_h channel"]:
    """Evaluate the plane phi_d = 90 degrees as Burley draws it; the cube root, brightest 1."""
    angles = (np.arange(_SLICE) + 0.5) * np.pi / 2 / _SLICE
    theta_d, theta_h = np.meshgrid(angles, angles, indexing="ij")
    pair = pair_at(HalfDifference(theta_h, theta_d, np.full_like(theta_h, np.pi / 2)))
    found = np.asarray(_evaluate(brdf, *(part.reshape(-1, 3) for part in pair)))
    found = np.cbrt(np.maximum(np.nan_to_num(found), 0)).reshape(*theta_h.shape, -1)
    colours = found if found.shape[-1] == 3 else np.repeat(found[..., :1], 3, axis=-1)
    return np.clip(colours / max(float(np.percentile(colours, 98)), 1e-12), 0, 1)
