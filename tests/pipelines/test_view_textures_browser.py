"""Textures on a page in Chromium: pictures of their maps.

- A ball and a mesh are the exact integral: with K_d, K_s, sigma and normals of every texel, and
  with a base colour, metalness and roughness.
- Each map can be shown in the place of the object.
"""

import math

import numpy as np
import pytest
from stated_textures import (
    metal_maps,
    smooth_maps,
    texel_places,
    write_metal_result,
    write_result,
)
from test_exported_textures import egg
from test_view_browser import CHROMIUM, SIZE, browser, look, picture, tab  # noqa: F401
from view_pages import scene_of

from jaxrender.geometry import Sphere
from jaxrender.imaging import erode
from jaxrender.imaging.display import exposed
from jaxrender.pipelines.progress import SilentProgress
from jaxrender.pipelines.result import read_run
from jaxrender.pipelines.view import view_result
from jaxrender.pipelines.view.shown import rendered, seen_from
from jaxrender.pipelines.view.view import shown_of

VIEW = (40, 20)
KINDS = {
    "paint": (write_result, smooth_maps(texel_places(16), 1, True)),
    "metal": (write_metal_result, metal_maps(texel_places(16))),
}


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", [Sphere(), egg()], ids=["ball", "mesh"])
def test_a_texture_is_drawn_exactly(tab, tmp_path, shape, kind):  # noqa: F811
    write, maps = KINDS[kind]
    result = write(tmp_path / "cat", maps, shape)
    page = view_result(result)
    found = look(tab, page, *VIEW)
    shown = shown_of(read_run(result), SilentProgress())
    view = seen_from(shown, *(math.radians(x) for x in VIEW), SIZE)
    exposure = scene_of(page.read_text(encoding="utf-8"))["exposure"]
    truth = exposed(rendered(shown, view), exposure)
    inside = erode(view.hit, 2)
    apart = np.abs(found[..., :3].astype(int) - truth).max(axis=-1)[inside]
    # Along borders of texels a pixel may show the next one.
    assert np.percentile(apart, 95) <= 2
    assert shown.texture is not None
    choices = [name for name in shown.texture.choices if name != "picture"]
    assert len(choices) == {"paint": 5, "metal": 6}[kind]
    for choice in choices:
        tab.locator("#shown-choice").select_option(choice)
        tab.wait_for_timeout(300)
        assert np.abs(picture(tab).astype(int) - found).max() > 10
        assert tab.locator(f"[data-shown={choice}]:visible").count() == (choice != "kd")
    tab.locator("#shown-choice").select_option("picture")
    tab.wait_for_timeout(300)
    assert np.abs(picture(tab).astype(int) - found).max() <= 1
