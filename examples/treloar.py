"""Yeoh's law on Treloar's rubber: real data in three modes of tension.

A law in the first invariant alone cannot have all three modes right. The catalogue's
``second_invariant`` adds a term in √I₂; whether it is named, and what it gains, rests on whole
modes that are held out.
"""

import bayesdeg as bd


def main() -> None:
    study = bd.read_study("studies/treloar")
    model = bd.Model(study)
    base = bd.calibrate(model, effort="quick", seed=1)
    verdict = bd.criticise(base, seed=1)
    print(verdict, end="\n\n")
    final = bd.calibrate(model.with_verdict(verdict), effort="quick", seed=1)
    print(final.summary()[["mean", "q05", "q95", "unit"]].round(4))


if __name__ == "__main__":
    main()
