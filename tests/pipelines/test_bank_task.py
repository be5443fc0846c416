"""``brdf.model: bank`` from its config to its folder.

- A microfacet ball that no bank holds ends as ``misfit`` with its lobe named; the photographs are
  predicted as they are, and the result lists its lobes and is one material with them.
- It renders again, with a deviation; nothing can be supposed of it beforehand.
- What it cannot use is refused: a start, a light that is unknown.
"""

import numpy as np
import pytest
from small_captures import CONFIG, Ball, jaxrender, read_result, write_ball

from jaxrender.brdf import Bank, material_named
from jaxrender.io import read_image

TASK = CONFIG.replace("starts: 2, variants: false, refine_samples: 300", "refine_samples: 600")
BANK = ("brdf.model=bank",)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bank") / "capture"
    write_ball(folder, Ball()).write_text(TASK)
    return folder


@pytest.fixture(scope="module")
def finished(ball):
    out = ball.parent / "out"
    assert jaxrender("fit", str(ball / "config.yaml"), *BANK, f"output={out}") == 0
    return out, read_result(out)


def test_the_result_is_a_material_whose_lobes_are_listed(finished):
    _, result = finished
    brdf = result["brdf"]
    assert brdf["model"] == "bank"
    material = material_named("bank", brdf)
    assert isinstance(material, Bank)
    total = np.sum([lobe["weight"] for lobe in brdf["lobes"]], axis=0)
    np.testing.assert_allclose(np.add(brdf["kd"], brdf["ks"]), total, rtol=1e-9)
    assert set(result["interval90"]) == set(result["identifiable"]) == {"kd", "ks"}
    assert "forecast" not in result


def test_the_page_lists_its_lobes(finished):
    out, result = finished
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "The lobes in use" in page
    # Lobes that are not there have no error, and trade with nothing.
    assert set(result["correlations"]["numbers"]) <= {
        f"{name}[{channel}]" for name in ("kd", "ks") for channel in range(3)
    }
    assert page.count(" facets</td>") == sum(
        lobe["kind"] in ("ggx", "beckmann") and any(lobe["weight"])
        for lobe in result["brdf"]["lobes"]
    )


def test_a_lobe_that_no_bank_has_is_named(finished):
    _, result = finished
    assert result["outcome"] == "misfit"
    assert result["diagnosis"][0]["cause"] == "lobe"


def test_photographs_are_predicted(finished, ball):
    out, result = finished
    photograph, predicted = (
        read_image(path).pixels for path in (ball / "images/2.exr", out / "images/2_predicted.exr")
    )
    inside = photograph.sum(axis=-1) > 0.2 * photograph.max()
    off = np.median(np.abs(predicted[inside] / photograph[inside] - 1))
    assert off < 2 * result["residual"]["relative_rms"]


def test_what_it_cannot_use_is_refused(ball, tmp_path, capsys):
    config, dark = ball / "config.yaml", ball / "dark.yaml"
    lines = TASK.replace("task: brdf", "task: factorize").splitlines()
    dark.write_text(
        "\n".join(line for line in lines if "lighting" not in line and "solve" not in line)
    )
    for given, words in (
        ((config, "solve.starts=3"), "has one minimum, whatever the start"),
        ((config, "brdf.ks=0.1"), "has no ks"),
        ((dark,), "found under known light alone"),
    ):
        assert jaxrender("fit", *map(str, given), *BANK, f"output={tmp_path}/o") != 0
        assert words in capsys.readouterr().err
    assert jaxrender("analyze", str(config), *BANK) != 0
    assert "nobody can suppose" in capsys.readouterr().err
