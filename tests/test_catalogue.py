"""The catalogue of models and what is derived from it, each model tried by itself.

- Its class exists, has every number as its own, takes what is typical, and refuses what lies
  outside the stated interval; whether its lobe is about R is what the class is.
- Recipe, config, command line, result and registry make one and the same material of it.
- A config refuses a number outside the interval, and a name that there is none of.
- Every number has a description in the schema, a line in the report and a place in the README.
- Intervals hold what they say.
"""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from jaxrender.brdf import BRDFS, PARAMETRIC, Bank, Glossy, brdf_named, lobe_named, material_named
from jaxrender.catalogue import MODELS, NAMES, STATED, Interval, described, numbers_named
from jaxrender.inverse.own_words import OwnWords, plain
from jaxrender.pipelines.config import BrdfConfig, RecipeBrdfConfig, RunConfig
from jaxrender.pipelines.lobes import model_of
from jaxrender.pipelines.report.parameters import parameters
from jaxrender.pipelines.report.texture import TextureContents
from jaxrender.pipelines.scene import lobe_of, true_material, unknowns_of

README = Path(__file__).parents[1] / "README.md"
KD, KS = [0.1, 0.2, 0.15], [0.3, 0.3, 0.3]
SEARCHED = [
    (model.name, number.name)
    for model in MODELS.values()
    for number in model.numbers
    if number.part in ("searched", "stated")
]


def typical(model):
    """A material's own numbers as a recipe states them: one amplitude in colour, others grey."""
    amounts = {n.name: KS for n in MODELS[model].numbers if n.part == "amplitude"} | {"kd": KD}
    return {n.name: amounts.get(n.name, n.typical) for n in MODELS[model].numbers}


def at_some_directions(brdf):
    directions = np.random.default_rng(0).normal(size=(2, 30, 3))
    directions[..., 2] = np.abs(directions[..., 2])
    return np.asarray(
        brdf.evaluate(*directions / np.linalg.norm(directions, axis=-1, keepdims=True))
    )


@pytest.mark.parametrize("name", STATED)
def test_the_class_is_what_the_catalogue_says(name):
    model, kind = MODELS[name], BRDFS[name]
    fields = {field.name for field in dataclasses.fields(kind)}
    assert {*model.names("searched", "stated"), *model.options, *model.fixed} <= fields
    if name == "lambertian":
        return
    kind = PARAMETRIC[name]
    assert model.about_mirror == issubclass(kind, Glossy)
    assert model.names("amplitude") == kind.amplitude_names
    assert model.names("searched") == tuple(one.name for one in lobe_named(name).searched)


@pytest.mark.parametrize(("name", "number"), SEARCHED)
def test_a_class_takes_what_is_inside_and_refuses_what_is_outside(name, number):
    entry = MODELS[name].number(number)
    amounts = MODELS[name].names("amplitude")
    own = {k: np.array(v) if k in amounts else v for k, v in typical(name).items()}
    assert entry.domain.holds(entry.typical)
    for end, outwards in ((entry.domain.low, -1), (entry.domain.high, 1)):
        if np.isinf(end):
            continue
        inside, outside = end - 1e-3 * outwards, end + 1e-3 * outwards
        brdf_named(name, **{**own, number: inside})
        with pytest.raises(ValueError, match=number):
            brdf_named(name, **{**own, number: outside})
        assert entry.domain.holds(inside)
        assert not entry.domain.holds(outside)


@pytest.mark.parametrize("name", STATED)
def test_every_way_to_name_a_material_makes_the_same(name):
    numbers = typical(name)
    expected = at_some_directions(material_named(name, numbers))
    recipe = RecipeBrdfConfig.model_validate({"model": name, **numbers})
    np.testing.assert_array_equal(at_some_directions(true_material(recipe)), expected)
    np.testing.assert_allclose(at_some_directions(brdf_named(name, **numbers)), expected, rtol=1e-7)
    words = OwnWords(name, material_named(name, numbers))
    said = {key: plain(value) for key, value in numbers.items()} | words.choices()
    np.testing.assert_array_equal(at_some_directions(material_named(name, said)), expected)
    assert at_some_directions(model_of(name).brdf).any()


@pytest.mark.parametrize("name", STATED)
def test_a_config_fixes_the_numbers_of_its_model(name):
    known = {"model": name, **typical(name)}
    if "ks" in known:
        known["ks_per_channel"] = True
    brdf = BrdfConfig.model_validate(known)
    lobe = lobe_of(brdf)
    assert type(lobe) is type(lobe_named(name))
    config = RunConfig.model_validate({"task": "brdf", "capture": {"recipe": "r"}, "brdf": known})
    unknowns = unknowns_of(config, 1)
    numbers = {name: unknowns[name].fixed[0] for name in lobe.numbers}
    made = lobe.with_numbers(numbers).with_amplitudes(
        *(np.broadcast_to(unknown.fixed, 3) for unknown in unknowns.amplitudes)
    )
    expected = at_some_directions(material_named(name, typical(name)))
    np.testing.assert_allclose(at_some_directions(made), expected, rtol=1e-6)


@pytest.mark.parametrize(("name", "number"), SEARCHED)
def test_a_config_refuses_what_is_outside(name, number):
    domain = MODELS[name].number(number).domain
    for outside in (domain.low - 1e-3, domain.high + 1e-3):
        if np.isfinite(outside):
            with pytest.raises(ValidationError, match=f"{outside:g}|greater than|less than"):
                BrdfConfig.model_validate({"model": name, number: outside})
            with pytest.raises(ValidationError, match=f"{outside:g}|greater than|less than"):
                RecipeBrdfConfig.model_validate(
                    {"model": name, **typical(name), number: float(outside)}
                )


@pytest.mark.parametrize("name", MODELS)
def test_a_report_shows_every_number(name):
    brdf = {"model": name, **typical(name)}
    result = {"brdf": brdf, "identifiable": dict.fromkeys(typical(name), True)}
    shown = parameters(TextureContents("a title", result, None, None, ()))
    assert [one.meaning for one in shown] == [n.meaning for n in MODELS[name].numbers]
    assert all(one.lines for one in shown)


def test_a_material_that_nobody_states_is_made_of_what_a_result_says():
    black = Bank.black()
    weights = np.random.default_rng(0).uniform(0, 0.01, (len(black.lobes), 3))
    bank = black.with_amplitudes(np.array(KD), *weights)
    words = OwnWords("bank", bank).choices()
    made = material_named("bank", json.loads(json.dumps(words)))
    np.testing.assert_allclose(at_some_directions(made), at_some_directions(bank), rtol=1e-12)
    assert PARAMETRIC["bank"] is type(lobe_named("bank")) is Bank
    with pytest.raises(ValidationError, match="bank"):
        RecipeBrdfConfig.model_validate({"model": "bank", "kd": KD})


def test_every_number_is_described():
    for section in (BrdfConfig, RecipeBrdfConfig):
        fields = section.model_fields
        assert {*NAMES} <= {*fields}
        for name in NAMES:
            assert fields[name].description == described(name)
            for number in numbers_named(name).values():
                assert number.meaning in described(name)


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_the_readme_has_a_row_for_every_model(model):
    names = model.names("amplitude", "searched")
    found = " ".join(name for name in names if name not in model.settled)
    stated = [f"`{name}`" for name in (*model.options, *model.names("stated"))]
    stated = ", ".join(stated + [f"`{name}` ({value:g})" for name, value in model.settled.items()])
    row = f"| `{model.name}` | {model.surface} | `{found}` | {stated} |"
    assert row in README.read_text(encoding="utf-8").splitlines()


def test_no_model_of_that_name():
    with pytest.raises(ValueError, match="no model to fit is named 'wadr', did you mean 'ward'"):
        lobe_named("wadr")
    with pytest.raises(KeyError, match="sigma"):
        MODELS["ward"].number("sigma")


@pytest.mark.parametrize(
    ("text", "inside", "outside", "words"),
    [
        ("(0, 1]", (1e-9, 1.0), (0.0, 1.1), "above 0 and at most 1"),
        ("[2, inf)", (2.0, 1e9), (1.9,), "at least 2"),
        ("[0, 1.5)", (0.0, 1.4), (-0.1, 1.5), "at least 0 and below 1.5"),
    ],
)
def test_intervals(text, inside, outside, words):
    interval = Interval(text)
    assert all(map(interval.holds, inside))
    assert not any(map(interval.holds, outside))
    assert interval.words == words
