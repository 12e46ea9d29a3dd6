"""What if the prior were another.

The same films, calibrated with the default prior of C1 and with one that is far too sure of a
softer gel. The posterior moves towards the prior, and the evidence says which of the two the data
prefer.
"""

from dataclasses import replace

import bayesdeg as bd

SHOWN = ["c1_at_0", "c1_at_25", "stiffness_scatter"]


def main() -> None:
    study = bd.read_study("studies/gelatin_actuator")
    films = replace(study, actuator=None, summary=None)
    softer = replace(films.settings, priors={"c1_at_0": bd.LogNormal(0.2, 0.05)})
    for words, settings in (("default prior", films.settings), ("sure of a softer gel", softer)):
        fit = bd.calibrate(bd.Model(replace(films, settings=settings)), effort="quick", seed=1)
        print(f"{words}: ln evidence {fit.log_evidence:.1f}")
        print(fit.summary().loc[SHOWN, ["mean", "q05", "q95", "unit"]].round(3), end="\n\n")


if __name__ == "__main__":
    main()
