"""``jaxrender analyze``: the table, the figure, and what it refuses."""

import numpy as np
import pytest

from jaxrender.cli import main
from jaxrender.io import write_image


@pytest.fixture
def panorama(tmp_path):
    pixels = np.full((40, 80, 3), 0.1)
    pixels[10:13, 20:24] = 50
    write_image(tmp_path / "light.exr", pixels)
    return tmp_path / "light.exr"


def test_the_table_says_what_is_well_posed(panorama, capsys):
    figure = panorama.parent / "spectra.png"
    options = ["--band-limit", "12", "--figure", str(figure)]
    brdfs = ["--brdf", "lambertian", "--brdf", "mirror"]
    assert main(["analyze", str(panorama), *brdfs, *options]) == 0
    text = capsys.readouterr().out
    assert "inverse lighting: well posed up to degree 2, and for 4, 6, 8" in text
    assert "inverse lighting: well posed for all degrees up to 12" in text
    assert "lambertian  (about the normal)" in text
    assert figure.stat().st_size > 10_000


@pytest.mark.slow
def test_uniform_light_tells_the_mean_alone(tmp_path, capsys):
    write_image(tmp_path / "grey.exr", np.ones((32, 64, 3)))
    assert main(["analyze", str(tmp_path / "grey.exr"), "--band-limit", "8"]) == 0
    assert "inverse BRDF:     well posed up to degree 0\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--band-limit", "20"], "ask for 19 or less"),
        (["--noise", "0"], "noise=0.0"),
        (["--brdf", "mirrror"], "did you mean 'mirror'?"),
        (["--convention", "cross"], "wants 3:4"),
    ],
)
def test_bad_input(panorama, capsys, options, message):
    limit = [] if "--band-limit" in options else ["--band-limit", "8"]
    assert main(["analyze", str(panorama), *limit, *options]) == 2
    assert message in capsys.readouterr().err
