from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import example, given, settings
from hypothesis import strategies as st

from bayesdeg.data.study import read_study
from bayesdeg.errors import StudyError

ACTUATOR = b"""specimen_id,degradation_pct,pressure_kPa,curvature_per_m,cycle,branch,time_s,ruptured
a1,0,0,0,1,loading,0,0
a1,0,20,1.5,1,loading,1,0
a1,0,20,1.8,1,unloading,2,0
a2,25,40,,1,loading,0,1
"""
SUMMARY = b"""quantity,degradation_pct,value,sd,n,unit,source
young_modulus,0,1.73,0.15,3,MPa,text
ruptured_count,25,2,,3,,text
"""
TOML = b'seed = 7\n[actuator]\nlength = 50\n[priors]\nc1 = {law = "normal", mean = 1, sd = 1}\n'
PIECES = st.one_of(
    st.binary(max_size=4),
    st.sampled_from([b",", b";", b"\n", b'"', b"#", b"-", b"nan", b"1e999", b"[", b"=", b"\xff"]),
)


@st.composite
def spoilt(draw: st.DrawFn, content: bytes) -> bytes:
    for _ in range(draw(st.integers(0, 3))):
        start = draw(st.integers(0, len(content)))
        cut = draw(st.integers(0, 12))
        content = content[:start] + draw(PIECES) + content[start + cut :]
    return content


@settings(max_examples=60, deadline=None)
@given(actuator=spoilt(ACTUATOR), summary=spoilt(SUMMARY), toml=spoilt(TOML))
@example(actuator=b",,,\n", summary=b'"', toml=b"=")
@example(actuator=b"a\n1,2\n", summary=b"\xef\xbb\xbf", toml=b"priors = 1")
@example(actuator=b"ruptured,specimen_id\n1,a,\n", summary=SUMMARY, toml=b"priors.a.b.c.law = 1")
def test_whatever_the_files_hold_the_answer_is_a_study_or_its_faults(
    actuator: bytes, summary: bytes, toml: bytes
) -> None:
    with TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "actuator.csv").write_bytes(actuator)
        (folder / "summary.csv").write_bytes(summary)
        (folder / "study.toml").write_bytes(toml)
        with suppress(StudyError):
            study = read_study(folder)
            assert study.actuator is not None
            assert study.actuator["pressure_kPa"].notna().all()
