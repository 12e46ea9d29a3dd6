"""A study from its folder to its verdict.

The verbs of the command line from Python: read, calibrate, criticise, calibrate again with what
was named, and compare on held-out specimens.
"""

import bayesdeg as bd


def main() -> None:
    study = bd.read_study("studies/gelatin_actuator")
    model = bd.Model(study, bd.emulator(study))
    base = bd.calibrate(model, effort="quick", seed=1)
    verdict = bd.criticise(base, seed=1)
    print(verdict, end="\n\n")

    final = bd.calibrate(model.with_verdict(verdict), effort="quick", seed=1)
    gain = bd.compare(base, final)
    pooled = gain[gain["degradation_pct"] == "all"]
    print(pooled[["model", "elpd_diff", "elpd_diff_se", "rmse_per_m"]].round(2).to_string())


if __name__ == "__main__":
    main()
