"""A study folder small enough to read a hundred times."""

from bayesdeg.data.study import read_study

SETTINGS = 'title = "Small"\nseed = 7\n'
ACTUATOR = (
    "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m\n"
    + "".join(
        f"a{k},{level},0.5,{p},{0.1 * p * (1.0 - 0.02 * level):.4f}\n"
        for k, level in enumerate((0, 10, 25))
        for p in (0, 40, 80, 120)
    )
)
TENSILE = (
    "specimen_id,degradation_pct,mode,stretch,stress_MPa,stress_measure\n"
    "f1,0,uniaxial,1.2,0.30,nominal\n"
    "f1,0,uniaxial,1.6,0.70,nominal\n"
    "f2,25,uniaxial,1.1,0.90,cauchy\n"
    "f2,25,uniaxial,1.3,2.60,cauchy\n"
)
BREAKS = "specimen_id,degradation_pct,elongation_pct\nb1,0,208\nb2,0,215\nb3,25,55\n"
SUMMARY = (
    "quantity,degradation_pct,value,sd,n,unit,source\n"
    "young_modulus,0,1.73,0.15,3,MPa,the paper\n"
    "elongation_at_break,0,209.8,6.3,3,%,the paper\n"
    "volume_ratio,,0.62,0.07,4,–,the paper\n"
    "r_squared,25,0.861,,13,–,the paper\n"
)
FILES = {
    "study.toml": SETTINGS,
    "actuator.csv": ACTUATOR,
    "tensile.csv": TENSILE,
    "break.csv": BREAKS,
    "summary.csv": SUMMARY,
}


def study_in(folder, texts=None, *, without=()):
    """Write a study, some of its texts replaced or left out, and read it."""
    for name, text in (FILES | (texts or {})).items():
        if name not in without:
            (folder / name).write_text(text, encoding="utf-8")
    return read_study(folder)
