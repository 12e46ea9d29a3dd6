from dataclasses import replace

import pytest

from bayesdeg.data.settings import (
    CauseOptions,
    Dimensions,
    Known,
    MaterialOptions,
    MixtureRecipe,
    Noise,
    Paper,
    SamplingOptions,
    Settings,
    TensileOptions,
    parse_settings,
)
from bayesdeg.priors import Normal

CONTRACT = """
title = "A study"
seed = 20211124
[actuator]
length = 50.0
width = 10.0
height = 10.0
chambers = 5
floor = 2.0
roof = 2.0
side_wall = 2.0
end_wall = 3.0
chamber_wall = 1.5
gap = 2.0
channel_width = 2.0
channel_height = 1.5
channel_roof = 1.0
[paper]
thickness = 0.1
[priors]
"volume_ratio" = { law = "normal", mean = 0.62, sd = 0.07 }
[noise]
degradation_sd_pct = 1.0
[causes]
candidates = "all"
[sampling]
effort = "standard"
"""


def parse(text: str) -> Settings:
    settings, faults = parse_settings(text.encode())
    assert faults == ()
    return settings


def test_the_contract_spells_out_the_defaults() -> None:
    prior = {"volume_ratio": Normal(mean=0.62, sd=0.07)}
    assert parse(CONTRACT) == replace(Settings(), title="A study", priors=prior)


def test_law_range_and_vendors_figures_are_taken_over() -> None:
    settings = parse(
        "[material]\nlaw = 'neo_hookean'\nstretch_range = [1, 2.5]\n"
        "[vendor]\nmodulus_100 = 69\nsource = 'data sheet'\n"
        "elongation_at_break = { value = 900, sd = 90 }\n"
    )
    assert settings.material.law == "neo_hookean"
    assert settings.material.stretch_range == (1.0, 2.5)
    assert settings.vendor.modulus_100 == Known(69.0, 0.2 * 69.0)
    assert settings.vendor.elongation_at_break == Known(900.0, 90.0)
    assert settings.vendor.source == "data sheet"


def test_empty_file_gives_the_defaults() -> None:
    assert parse("") == Settings()
    assert parse("\ufeff# only a comment\n") == Settings()


def test_every_key_is_taken_over() -> None:
    text = """
title = "t"
seed = 3
virtual = true
note = "n"
priors.creep.rate = { law = "normal", mean = 1, sd = 2 }
actuator = { length = 60, chambers = 4, gap = 0 }
paper.thickness = 0.2
noise.degradation_sd_pct = 0
causes.candidates = ["creep", "erosion"]
sampling.effort = "quick"
tensile.fit_modes = ["uniaxial"]
material.order = 3
"""
    expected = Settings(
        title="t",
        seed=3,
        dimensions=Dimensions(length=60.0, chambers=4, gap=0.0),
        paper=Paper(0.2),
        priors={"creep.rate": Normal(mean=1.0, sd=2.0)},
        noise=Noise(0.0),
        causes=CauseOptions(("creep", "erosion")),
        sampling=SamplingOptions("quick"),
        tensile=TensileOptions(("uniaxial",)),
        material=MaterialOptions(order=3),
        virtual=True,
        note="n",
    )
    assert parse(text) == expected


@pytest.mark.parametrize(
    ("text", "row", "column", "value", "says"),
    [
        ("\nsede = 7", 2, "sede", "7", "'seed'"),
        ("[actuator]\nlenght = 60.0", 2, "actuator.lenght", "60.0", "'length'"),
        ("[actuatr]\nlength = 60.0", 1, "actuatr", None, "'actuator'"),
        ("effort = 'quick'", 1, "effort", '"quick"', "under [sampling]"),
        ("[noise]\nvirtual = true", 2, "noise.virtual", "true", "above the first"),
        ("seed = true", 1, "seed", "true", "whole number"),
        ("seed = -1", 1, "seed", "-1", "from 0"),
        ("seed = 1.0", 1, "seed", "1.0", "whole number"),
        ("title = 3", 1, "title", "3", "text"),
        ("virtual = 1", 1, "virtual", "1", "true or false"),
        ("[actuator]\nlength = '50'", 2, "actuator.length", '"50"', "a number"),
        ("[actuator]\nlength = nan", 2, "actuator.length", "nan", "a number"),
        ("[actuator]\nchambers = 5.0", 2, "actuator.chambers", "5.0", "whole number"),
        ("[actuator]\nlength = 20.0", 1, "actuator", None, "in the length"),
        ("[actuator]\nroof = -1.0", 1, "actuator", None, "0, not -1"),
        ("[paper]\nthickness = 0", 2, "paper.thickness", "0", "above 0"),
        ("[noise]\ndegradation_sd_pct = 60", 2, "noise.degradation_sd_pct", "60", "0 to 29"),
        ("[noise]\ndegradation_sd_pct = -1", 2, "noise.degradation_sd_pct", "-1", "from 0"),
        ("[sampling]\neffort = 'quik'", 2, "sampling.effort", '"quik"', "'quick'"),
        ("[causes]\ncandidates = 'creep'", 2, "causes.candidates", '"creep"', "cause names"),
        ("[causes]\ncandidates = [1]", 2, "causes.candidates", "[1]", "cause names"),
        ("[tensile]\nfit_modes = []", 2, "tensile.fit_modes", "[]", "non-empty list"),
        ("[tensile]\nfit_modes = ['shear']", 2, "tensile.fit_modes", '["shear"]', "planar"),
        ("[material]\norder = 4", 2, "material.order", "4", "from 0 to 3"),
        ("[material]\norder = 2.0", 2, "material.order", "2.0", "whole number"),
        ("[material]\nordr = 2", 2, "material.ordr", "2", "'order'"),
        ("order = 2", 1, "order", "2", "under [material]"),
        ("[material]\nlaw = 'neohookean'", 2, "material.law", '"neohookean"', "'neo_hookean'"),
        ("[material]\nlaw = 'gent'", 2, "material.law", '"gent"', "material_laws.csv"),
        ("[material]\nlaw = 'ogden'", 2, "material.law", '"ogden"', '"neo_hookean"'),
        ("[material]\nlaw = 3", 2, "material.law", "3", "mooney_rivlin"),
        ("[material]\nstretch_range = [2, 1]", 2, "material.stretch_range", "[2, 1]", "smaller"),
        ("[material]\nstretch_range = [0, 2]", 2, "material.stretch_range", "[0, 2]", "above 0"),
        ("[material]\nstretch_range = 2.0", 2, "material.stretch_range", "2.0", "two stretches"),
        (
            "[material]\nstretch_range = [1, 2, 3]",
            2,
            "material.stretch_range",
            "[1, 2, 3]",
            "two stretches",
        ),
        ("[vendor]\nmodulus_100 = -69", 2, "vendor.modulus_100", "-69", "kPa"),
        ("[vendor]\nmodulus = 69", 2, "vendor.modulus", "69", "'modulus_100'"),
        (
            "[vendor]\nmodulus_100 = { value = 69, sd = 0 }",
            2,
            "vendor.modulus_100",
            "{ value = 69, sd = 0 }",
            "sd above 0",
        ),
        (
            "[vendor]\nelongation_at_break = { value = 900, std = 90 }",
            2,
            "vendor.elongation_at_break",
            "{ value = 900, std = 90 }",
            "sd = ..",
        ),
        ("[priors]\nc1 = 3", 2, "priors.c1", "3", "law ="),
        (
            "[priors]\nc1 = { law = 'norml', mean = 1, sd = 1 }",
            2,
            "priors.c1",
            '{ law = "norml", mean = 1, sd = 1 }',
            "'normal'",
        ),
        ("noise = 3", 1, "noise", "3", "[noise]"),
        ("seed = 7\ntitle = unquoted", 2, None, "title = unquoted", "not valid TOML"),
        ("seed = 7\nseed = 8", 2, None, "seed = 8", "not valid TOML"),
        ("seed = 7\n[actuator", 2, None, "[actuator", "not valid TOML"),
    ],
)
def test_each_slip_is_one_fault(
    text: str, row: int, column: str | None, value: str | None, says: str
) -> None:
    _, faults = parse_settings(text.encode())
    assert len(faults) == 1, faults
    (fault,) = faults
    assert (fault.file, fault.row, fault.column, fault.value) == ("study.toml", row, column, value)
    assert says in f"{fault.problem}; {fault.remedy}"


def test_settings_that_are_not_utf8() -> None:
    _, (fault,) = parse_settings(b"seed = 7\ntitle = '\xe4'")
    assert (fault.row, "UTF-8" in fault.problem) == (2, True)


def test_all_slips_come_together() -> None:
    _, faults = parse_settings(b"sede = 7\n[actuator]\nlenght = 1\nwidth = 'x'\n[noise]\na = 1")
    assert {fault.column for fault in faults} == {
        "sede",
        "actuator.lenght",
        "actuator.width",
        "noise.a",
    }


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"length": 0.0}, "length must"),
        ({"length": float("nan")}, "length must"),
        ({"channel_roof": -1.0}, "channel_roof must be above 0"),
        ({"gap": -0.1}, "gap must"),
        ({"chambers": 0}, "chambers must"),
        ({"chambers": 2.5}, "chambers must"),
        ({"end_wall": 15.0}, "in the length"),
        ({"chambers": 10}, "in the length"),
        ({"side_wall": 5.0}, "in the width"),
        ({"roof": 8.0}, "in the height"),
        ({"channel_width": 6.1}, "wider than"),
        ({"channel_height": 6.1}, "higher than"),
        ({"channel_height": 6.0, "channel_roof": 2.0}, "leave no slot"),
    ],
)
def test_impossible_dimensions_are_named_once(change: dict[str, float], says: str) -> None:
    problems = replace(Dimensions(), **change).problems()
    assert len(problems) == 1
    assert says in problems[0]


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"gap": 0.0},
        {"gap": 0.0, "channel_height": 6.0, "channel_roof": 3.0},
        {"chambers": 1, "channel_width": 9.0},
        {"end_wall": 14.9},
        {"channel_width": 6.0},
    ],
)
def test_possible_dimensions(change: dict[str, float]) -> None:
    assert replace(Dimensions(), **change).problems() == ()


def test_several_impossible_dimensions_are_all_named() -> None:
    assert len(Dimensions(side_wall=6.0, roof=9.0, end_wall=30.0).problems()) == 3


def test_a_recipe_is_read_with_or_without_its_uncertainty() -> None:
    text = "[shrinkage]\nglycerol = 1.5\ngelatin_density = { value = 1.3, sd = 0.05 }\n"
    recipe = parse(text).shrinkage
    assert recipe == MixtureRecipe(glycerol=Known(1.5), gelatin_density=Known(1.3, 0.05))
    assert parse("[shrinkage]\n[shrinkage.water]\nvalue = 9\n").shrinkage.water == Known(9.0)
    assert parse("").shrinkage == MixtureRecipe()


@pytest.mark.parametrize(
    ("line", "column", "suggested"),
    [
        ("gelatine = 2", "shrinkage.gelatine", "'gelatin'"),
        ("glycerol = 0", "shrinkage.glycerol", "above 0"),
        ("water = -8.0", "shrinkage.water", "above 0"),
        ("water_density = inf", "shrinkage.water_density", "[g/cm³]"),
        ('water = "8"', "shrinkage.water", "above 0"),
        ("water = { value = 8, sd = -1 }", "shrinkage.water", "sd"),
        ("water = { value = 8, sd = 8 }", "shrinkage.water", "below value"),
        ("water = { value = 0 }", "shrinkage.water", "above 0"),
        ("water = { sd = 1 }", "shrinkage.water", "value"),
        ("water = { value = { value = 8 } }", "shrinkage.water", "above 0"),
        ("water = { valeu = 8, sd = 1 }", "shrinkage.water", "'value'"),
    ],
)
def test_faults_of_a_recipe_are_named(line: str, column: str, suggested: str) -> None:
    settings, faults = parse_settings(f"[shrinkage]\n{line}\n".encode())
    assert [(fault.column, fault.row) for fault in faults] == [(column, 2)]
    assert suggested in faults[0].remedy
    assert settings.shrinkage == MixtureRecipe()
