"""One report that several files of tests read."""

import pytest
from report_samples import RESULT, sample_environment, sample_fit, sample_frame

from jaxrender.inverse import KnownLight
from jaxrender.lighting import DirectionalSources
from jaxrender.pipelines.report import write_report
from jaxrender.pipelines.report.contents import MaterialContents
from jaxrender.pipelines.report.known_light import material_page


@pytest.fixture(scope="module")
def light():
    return KnownLight(sample_environment(), DirectionalSources.none())


@pytest.fixture(scope="module")
def contents(light):
    frames = (sample_frame(), sample_frame("view01", seed=1))
    return MaterialContents("teflon", RESULT, sample_fit(light), light, frames)


@pytest.fixture(scope="module")
def page(contents, tmp_path_factory):
    path = write_report(tmp_path_factory.mktemp("report"), material_page(contents))
    return path.read_text(encoding="utf-8")
