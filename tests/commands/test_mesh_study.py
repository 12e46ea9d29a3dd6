"""Studies of parts that a user has meshed: checked with one line a fault, drawn, simulated, run."""

import meshio
import numpy as np
import pandas as pd
import pytest

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.reading import read_study
from bayesdeg.data.plausibility import doubts
from bayesdeg.surrogate.kept import mesh_error_of
from tests.actuator.parts import half, tetrahedral, whole, write
from tests.run.study_files import SETTINGS, study_in

MESH = '[actuator]\nkind = "mesh"\nfile = "part.msh"\n'
ACTUATOR = (
    "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m,cavity_volume_ml\n"
    "a0,0,0.5,0,0.0,0\na0,0,0.5,40,3.3,0.025\na0,0,0.5,80,6.9,0.053\n"
)


@pytest.fixture
def command(command):
    """Run a command on a study of a part."""
    write(command.study / "part.msh", half())
    study_in(command.study, {"study.toml": SETTINGS + MESH, "actuator.csv": ACTUATOR})
    return command


def test_check_draws_the_part_and_says_what_it_is(command):
    code, said = command("check")
    assert code == 0, said
    assert "mesh actuator" in said
    assert "part.msh" in said
    assert "is not known" in said
    rows = [line for line in said.splitlines() if line and set(line) <= set("# =")]
    assert sum("#" in row for row in rows) > 5
    assert [set(row) for row in rows].count({"="}) == 1


def test_a_mesh_error_that_is_stated_is_taken(command):
    text = SETTINGS + MESH + "mesh_error = 0.012\n"
    (command.study / "study.toml").write_text(text, encoding="utf-8")
    code, said = command("check")
    assert code == 0
    assert "is not known" not in said
    geometry = geometry_of_study(read_study(command.study).settings)
    assert mesh_error_of(geometry) == 0.012


@pytest.mark.parametrize(
    ("cut", "layer", "doubted"),
    [
        (tetrahedral, "thickness = 0.5", 1),
        (tetrahedral, "thickness = 0.2", 0),
        (tetrahedral, 'kind = "none"\nthickness = 0.5', 0),
        (lambda part: part, "thickness = 0.5", 0),
    ],
    ids=["thick", "thin", "no layer", "bricks"],
)
def test_a_thick_layer_on_tetrahedra_is_doubted(cut, layer, doubted, command):
    write(command.study / "part.msh", cut(half()))
    text = f"{SETTINGS}{MESH}[constraint]\n{layer}\n"
    (command.study / "study.toml").write_text(text, encoding="utf-8")
    study = read_study(command.study)
    found = [d for d in doubts(study, outline(study).expected) if d.fault.file == "study.toml"]
    assert [d.fault.column for d in found] == ["thickness"] * doubted
    assert not any(doubt.impossible for doubt in found)
    code, said = command("check")
    assert code == 0, said
    assert said.count("column thickness") == doubted


def test_causes_of_walls_are_not_judged(command):
    plan = outline(read_study(command.study))
    assert {"wall_thickness", "erosion", "degraded_skin"} <= set(plan.unjudged)
    assert {"film_mismatch", "pressure_offset"} <= {cause.name for cause in plan.candidates}


def without(name):
    points, bricks, sides = half()
    return points, bricks, {n: faces for n, faces in sides.items() if n != name}


def holed():
    points, bricks, sides = half()
    return points, bricks, sides | {"cavity": sides["cavity"][1:]}


def inverted():
    points, bricks, sides = half()
    bricks = bricks.copy()
    bricks[3] = bricks[3][[4, 5, 6, 7, 0, 1, 2, 3]]
    return points, bricks, sides


def scaled(factor):
    points, bricks, sides = half()
    return points * factor, bricks, sides


def turned():
    points, bricks, sides = half()
    return points[:, [1, 2, 0]], bricks, sides


def in_pieces():
    points, bricks, sides = half()
    loose = np.arange(len(points), len(points) + 8)
    return (
        np.vstack([points, points[bricks[5]]]),
        np.vstack([np.delete(bricks, 5, 0), loose]),
        sides,
    )


def tilted():
    points, bricks, sides = whole()
    points = points.copy()
    points[:, 2] += 0.05 * points[:, 0]
    return points, bricks, sides


def shifted_line():
    points, bricks, sides = whole()
    points = points.copy()
    points[:, 1] += np.where(np.isclose(points[:, 1], 0.0), 0.2, 0.0)
    return points, bricks, {n: faces for n, faces in sides.items() if n != "constraint"}


FAULTS = {
    "no clamp": (without("clamp"), "clamp"),
    "no cavity": (without("cavity"), "cavity"),
    "no tip": (without("tip"), "tip"),
    "a hole": (holed(), "hole"),
    "inside out": (inverted(), "inverted"),
    "in micrometres": (scaled(1e3), "µm"),
    "in metres": (scaled(1e-3), "in m:"),
    "turned": (turned(), "clamp"),
    "in pieces": (in_pieces(), "2 pieces"),
    "tilted": (tilted(), "constraint"),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", ["check", "run"])
def test_each_fault_is_one_line(name, fault, command):
    part, word = FAULTS[fault]
    write(command.study / "part.msh", part)
    code, said = command(name)
    assert code == 2
    assert said.count("study.toml") == 1, said
    assert "part.msh" in said
    assert word in " ".join(said.split())
    assert "Traceback" not in said


def test_a_part_without_a_line_along_its_middle_is_refused(command):
    write(command.study / "part.msh", shifted_line())
    code, said = command("check")
    assert code == 2
    assert "middle" in said


@pytest.mark.parametrize(
    ("cells", "word"),
    [
        (lambda b: [("hexahedron", b[1:]), ("tetra", b[:1, [0, 1, 3, 4]])], "mixes"),
        (lambda b: [("wedge", b[:, [0, 1, 3, 4, 5, 7]])], "wedge"),
    ],
    ids=["mixed", "wedges"],
)
def test_cells_that_are_not_solved_are_refused_by_name(command, cells, word):
    points, bricks, _ = half()
    mesh = meshio.Mesh(points, cells(bricks))
    meshio.write(command.study / "part.msh", mesh, file_format="gmsh22")
    code, said = command("check")
    assert code == 2
    assert word in said
    assert "hexahedra" in said


@pytest.mark.fem
def test_a_part_of_tetrahedra_is_simulated_and_is_a_study_again(bayesdeg, command, monkeypatch):
    write(command.study / "part.msh", tetrahedral(half()))
    code, said = command("simulate", "--out", "virtual", "--workers", "1", "--quiet")
    assert code == 0, said
    made = pd.read_csv(command.study.parent / "virtual" / "actuator.csv", comment="#")
    assert np.all(np.diff(made["curvature_per_m"]) > 0.0)
    assert 0.01 < made["cavity_volume_ml"].iloc[-1] < 0.2
    assert bayesdeg("check", "virtual")[0] == 0


@pytest.mark.parametrize(
    ("stated", "word"),
    [
        ('file = "other.msh"', "does not exist"),
        ('file = "part.stl"', "known format"),
        ('file = "../part.msh"', "next to study.toml"),
        ("", "file ="),
        ('file = "part.msh"\nmesh_error = 2.0', "mesh_error"),
        ('file = "part.msh"\nchambers = 3', "chambers"),
        ('file = "part.msh"\n[constraint]\nheight = 1.0', "constraint"),
    ],
)
def test_what_the_settings_say_wrong_is_one_line(stated, word, command):
    text = SETTINGS + MESH.replace('file = "part.msh"', stated)
    (command.study / "study.toml").write_text(text, encoding="utf-8")
    code, said = command("check")
    assert code == 2
    assert word in " ".join(said.split())
    assert said.count("study.toml:") + said.count("study.toml,") <= 1


def test_a_damaged_file_is_refused(command):
    (command.study / "part.msh").write_bytes(b"$MeshFormat\n2.2 0 8\n$End\n\x00\xff")
    code, said = command("check")
    assert code == 2
    assert "part.msh" in said
    assert "Traceback" not in said


@pytest.mark.fem
def test_a_virtual_experiment_is_made_with_volumes_and_is_a_study_again(
    bayesdeg, command, monkeypatch
):
    code, said = command("simulate", "--out", "virtual", "--workers", "1", "--quiet")
    assert code == 0, said
    made = command.study.parent / "virtual"
    assert (made / "part.msh").read_bytes() == (command.study / "part.msh").read_bytes()
    header, *_, last = (made / "actuator.csv").read_text("utf-8").splitlines()[1:]
    volume = dict(zip(header.split(","), last.split(","), strict=True))["cavity_volume_ml"]
    assert 0.01 < float(volume) < 0.2
    assert bayesdeg("check", "virtual")[0] == 0


@pytest.mark.fem
def test_tip_forces_are_made_where_the_study_has_some(bayesdeg, command, monkeypatch):
    """Read by `check`, the same for a seed, and gone with the design that asked for them."""
    rows = "specimen_id,degradation_pct,pressure_kPa,tip_force_N\nt0,0,30,0.03\nt0,0,60,0.06\n"
    (command.study / "force.csv").write_text(rows, encoding="utf-8")
    made = command.study.parent / "virtual"
    texts = []
    for _ in range(2):
        code, said = command("simulate", "--out", "virtual", "--workers", "1", "--seed", "4")
        assert code == 0, said
        assert "not simulated" not in said
        texts.append((made / "force.csv").read_text("utf-8"))
    assert texts[0] == texts[1]
    forces = pd.read_csv(made / "force.csv", comment="#")["tip_force_N"].to_numpy()
    assert len(forces) == 2
    assert 0.0 < forces[0] < forces[1] < 1.0
    assert bayesdeg("check", "virtual")[0] == 0
    assert outline(read_study(made)).asked == ("cavity_volume", "tip_force")
    (command.study / "force.csv").unlink()
    assert command("simulate", "--out", "virtual", "--workers", "1", "--quiet")[0] == 0
    assert not (made / "force.csv").exists()


def test_scikit_fem_does_not_assemble_tetrahedra(command):
    write(command.study / "part.msh", tetrahedral(half()))
    code, said = command("simulate", "--out", "virtual", "--backend", "scikit-fem")
    assert code == 2
    assert "tetrahedra" in said
    assert not (command.study.parent / "virtual").exists()
