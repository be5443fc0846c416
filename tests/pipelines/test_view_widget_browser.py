"""The widget in Chromium, in the place where a notebook puts it.

- Its picture is the exact integral to 2 of 255, and follows what Python sets.
- What a person chooses goes back, and nothing is echoed; two widgets in one document are apart.
"""

import base64
import io
import json
import math

import numpy as np
import pytest
from PIL import Image
from test_view_browser import CHROMIUM, PATIENCE, SIZE, browser, tab  # noqa: F401
from view_pages import SUMMARY, shown

from jaxrender.imaging import erode
from jaxrender.imaging.display import exposed
from jaxrender.pipelines.view.layout import Facts
from jaxrender.pipelines.view.page import module_text
from jaxrender.pipelines.view.shown import rendered, seen_from
from jaxrender.pipelines.view.widget import Viewer

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")

# What a front end gives a widget: its traits, and a place.
FRONT_END = """
window.opened = async (address, values) => {
  const { default: { render } } = await import(address);
  const heard = {}, model = {
    values, saved: 0,
    get: (name) => values[name],
    set: (name, value) => { values[name] = value; },
    on: (name, call) => { (heard[name] = heard[name] || []).push(call); },
    off: (name, call) => { heard[name] = heard[name].filter((one) => one !== call); },
    save_changes: () => { model.saved += 1; },
    change: (name, value) => {
      values[name] = value;
      (heard[`change:${name}`] || []).forEach((call) => call());
    },
  };
  const el = document.createElement("div");
  el.style.width = "SIZEpx";
  document.body.append(el);
  return { model, el, close: render({ model, el }) };
};
"""
CANVAS = "document.querySelector('div > div').shadowRoot.getElementById('object')"


@pytest.fixture
def ball(tab, tmp_path):  # noqa: F811
    """A tab with a widget in it, and what it shows."""
    page = tmp_path / "notebook.html"
    page.write_text(f"<!doctype html><body><script>{FRONT_END}</script>".replace("SIZE", str(SIZE)))
    what = shown()
    widget = Viewer(what, Facts("ball", "", SUMMARY, False, None))
    tab.goto(page.as_uri())
    put(tab, "first", widget)
    return what, widget


def put(tab, name, widget) -> None:  # noqa: F811
    """Show a widget as ``window[name]``."""
    module = base64.b64encode(module_text().encode()).decode()
    values = {key: value for key, value in widget.get_state().items() if key in TRAITS}
    tab.evaluate(
        "async ([name, address, values]) => { window[name] = await opened(address, values); }",
        [name, f"data:text/javascript;base64,{module}", json.loads(json.dumps(values))],
    )


TRAITS = (
    "_scene", "_markup", "light", "shown", "base", "lobe", "roughness", "azimuth", "elevation",
    "zoom", "stops", "lamp", "turn", "coefficients",
)  # fmt: skip


def settled(tab, name="first") -> np.ndarray:  # noqa: F811
    """The picture, once nothing moves any more."""
    tab.wait_for_timeout(300)
    host = f"{name}.el.firstElementChild"
    tab.wait_for_function(f"{host}.dataset.state === 'settled'", timeout=PATIENCE)
    url = tab.evaluate(f"{host}.shadowRoot.getElementById('object').toDataURL('image/png')")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(url.split(",")[1]))))


def off(what, widget, found) -> int:
    size = len(found)
    view = seen_from(what, *(math.radians(x) for x in (widget.azimuth, widget.elevation)), size)
    truth = exposed(rendered(what, view), widget._scene["exposure"])
    inside = erode(view.hit, 1)
    return int(np.abs(found[..., :3].astype(int) - truth)[inside].max())


def test_the_picture_is_exact_and_follows_python(tab, ball):  # noqa: F811
    what, widget = ball
    assert off(what, widget, settled(tab)) <= 2
    assert tab.evaluate("first.model.saved") == 0
    widget.azimuth, widget.elevation, widget.base = -70, 35, [0.05, 0.1, 0.3]
    for name in ("azimuth", "elevation", "base"):
        tab.evaluate(f"first.model.change({name!r}, {json.dumps(getattr(widget, name))})")
    assert off(what._replace(brdf=widget.brdf), widget, settled(tab)) <= 2
    # Nothing that Python has set comes back.
    assert tab.evaluate("first.model.saved") == 0
    widget.roughness = 0.4
    tab.evaluate("first.model.change('roughness', 0.4)")
    assert off(what._replace(brdf=widget.brdf), widget, settled(tab)) <= 2
    before = settled(tab).astype(int)
    for name, value in (("light", "uniform"), ("lamp", [30, 20, 2]), ("stops", 1)):
        tab.evaluate(f"first.model.change({name!r}, {json.dumps(value)})")
        after = settled(tab).astype(int)
        assert np.abs(after - before).max() > 10, name
        before = after


def test_what_a_person_chooses_goes_back(tab, ball):  # noqa: F811
    settled(tab)
    get = lambda name: tab.evaluate(f"first.model.get({name!r})")  # noqa: E731
    tab.locator("#object").focus()
    tab.keyboard.press("ArrowRight")
    settled(tab)
    assert get("azimuth") == pytest.approx(35, abs=1e-6)
    tab.locator("input[name=light][value=dark]").check()
    settled(tab)
    assert get("light") == "dark"
    assert len(get("lamp")) == 3
    tab.locator("#slider-width").focus()
    tab.keyboard.press("End")
    settled(tab)
    assert get("roughness") == pytest.approx(0.8, rel=1e-6)
    tab.locator("#fitted").click()
    settled(tab)
    assert get("roughness") == pytest.approx(0.2, rel=1e-6)
    saved = tab.evaluate("first.model.saved")
    settled(tab)
    assert tab.evaluate("first.model.saved") == saved


def test_two_widgets_are_apart_and_one_is_closed(tab, ball):  # noqa: F811
    _, widget = ball
    put(tab, "second", widget)
    before = settled(tab).astype(int)
    tab.evaluate("second.model.change('base', [0.9, 0, 0])")
    assert np.abs(settled(tab, "second").astype(int) - before).max() > 10
    assert np.abs(settled(tab).astype(int) - before).max() == 0
    tab.evaluate("first.close()")
    assert tab.evaluate("first.el.childElementCount") == 0
    tab.evaluate("first.model.change('base', [0, 0, 0.9])")
    settled(tab, "second")
