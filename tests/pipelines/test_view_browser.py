"""The page of a result in Chromium, drawn by its software renderer.

- At three views the settled picture of a ball and of a convex mesh is the exact integral, to 2 of
  255; of a lamp and of light by its harmonics, too.
- Nothing is written to the console, nothing is asked from the network, and the page is no wider
  than a telephone.
- Keys and sliders change the picture, and "fitted values" brings it back.
- Without WebGL2 the still picture stays, with a word.

These need the package ``playwright`` and a Chromium of the system; elsewhere they are left out.
"""

import base64
import io
import math
import shutil

import numpy as np
import pytest
from PIL import Image
from view_pages import egg, page, scene_of, shown

from jaxrender.imaging import erode
from jaxrender.imaging.display import exposed
from jaxrender.lighting import LightNodes
from jaxrender.pipelines.view.shown import rendered, seen_from

sync_api = pytest.importorskip("playwright.sync_api")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")

SIZE, TELEPHONE = 96, {"width": 360, "height": 740}
VIEWS = ((40, 20), (-70, 35), (160, -30))
SOFTWARE = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
]
SETTLED = "html[data-state=settled]"
PATIENCE = 120_000


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as program:
        opened = program.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield opened
        opened.close()


@pytest.fixture
def tab(browser):
    """A tab of a telephone's size, and what went wrong in it."""
    opened = browser.new_page(viewport=TELEPHONE)
    trouble = []
    opened.on("console", lambda said: trouble.append(said.text))
    opened.on("pageerror", lambda error: trouble.append(str(error)))
    opened.on(
        "request",
        lambda asked: asked.url.startswith(("file:", "data:")) or trouble.append(asked.url),
    )
    yield opened
    opened.close()
    assert trouble == []


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    what = shown()
    path = tmp_path_factory.mktemp("ball") / "page.html"
    path.write_text(page(what), encoding="utf-8")
    return what, path


def picture(tab) -> np.ndarray:
    tab.wait_for_selector(SETTLED, state="attached", timeout=PATIENCE)
    url = tab.evaluate("document.getElementById('object').toDataURL('image/png')")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(url.split(",")[1]))))


def look(tab, path, azimuth, elevation) -> np.ndarray:
    tab.goto(f"{path.as_uri()}#azimuth={azimuth}&elevation={elevation}&size={SIZE}")
    tab.reload()
    return picture(tab)


def off(what, path, found, azimuth, elevation) -> np.ndarray:
    """The largest difference of each pixel's channels, without the rim."""
    exposure = scene_of(path.read_text())["exposure"]
    view = seen_from(what, math.radians(azimuth), math.radians(elevation), SIZE)
    truth = exposed(rendered(what, view), exposure)
    inside = erode(view.hit, 1)
    assert (found[inside][:, 3] == 255).all()
    return np.abs(found[..., :3].astype(int) - truth).max(axis=-1)[inside]


@pytest.mark.parametrize("view", VIEWS)
def test_a_ball_is_drawn_exactly(tab, ball, view):
    what, path = ball
    assert off(what, path, look(tab, path, *view), *view).max() <= 2


def test_a_convex_mesh_is_drawn_exactly(tab, tmp_path):
    what = shown(egg())
    path = tmp_path / "egg.html"
    path.write_text(page(what), encoding="utf-8")
    found = off(what, path, look(tab, path, *VIEWS[0]), *VIEWS[0])
    # Along edges a pixel may see the next face.
    assert np.percentile(found, 99) <= 2
    assert found.max() <= 6


def test_a_lamp_is_drawn_exactly(tab, ball):
    what, path = ball
    look(tab, path, 0, 0)
    exposure = scene_of(path.read_text())["exposure"]
    tab.locator("input[name=light][value=dark]").check()
    assert tab.locator("#lamp").is_checked()
    for name, value in (("azimuth", 30), ("elevation", 20)):
        tab.locator(f"#lamp-{name}").fill(str(value))
    tab.locator("#exposure").fill("0")
    found = picture(tab)
    azimuth, elevation = math.radians(30), math.radians(20)
    towards = [
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    ]
    strength = float(np.mean(np.sum(what.light.nodes.irradiance, axis=0))) / 4
    none = LightNodes(np.zeros((0, 3)), np.zeros((0, 3)))
    lamp = LightNodes(np.array([towards]), np.full((1, 3), strength))
    lit = what._replace(light=what.light._replace(fine=none, sources=lamp))
    view = seen_from(lit, 0.0, 0.0, SIZE)
    truth = exposed(rendered(lit, view), exposure)
    inside = erode(view.hit, 1)
    assert np.abs(found[..., :3].astype(int) - truth)[inside].max() <= 2


def test_keys_turn_the_object_and_sliders_change_it(tab, ball):
    _, path = ball
    before = look(tab, path, *VIEWS[0]).astype(int)
    width = tab.locator("#slider-width")
    width.focus()
    for _ in range(5):
        tab.keyboard.press("PageUp")
    wide = picture(tab).astype(int)
    assert np.abs(wide - before).max() > 10
    tab.locator("#fitted").click()
    tab.wait_for_timeout(300)
    assert np.abs(picture(tab).astype(int) - before).max() <= 1
    tab.locator("#object").focus()
    tab.keyboard.press("ArrowRight")
    tab.wait_for_timeout(300)
    turned = picture(tab).astype(int)
    assert np.abs(turned - before).max() > 10
    # Five degrees to the right: the viewer goes to the left.
    there = look(tab, path, VIEWS[0][0] - 5, VIEWS[0][1]).astype(int)
    assert np.abs(turned - there).max() <= 1


def test_the_page_is_no_wider_than_a_telephone(tab, ball):
    look(tab, ball[1], 0, 0)
    assert tab.evaluate("document.documentElement.scrollWidth") <= TELEPHONE["width"]


def test_without_webgl_a_still_picture_stays(tab, ball):
    tab.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    tab.goto(ball[1].as_uri())
    tab.wait_for_selector("html[data-state=still]", state="attached", timeout=PATIENCE)
    assert tab.locator("#still").is_visible()
    assert "no WebGL2" in tab.locator("#trouble").inner_text()
    assert tab.locator("#object").is_hidden()
