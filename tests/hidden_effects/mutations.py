"""Whether tests of hidden effects fail where the cause that explains one is made wrong.

    uv run python -m tests.hidden_effects.mutations --json

Each planted study is judged; then anew with its cause made idle, with a rule that is wrong by 30 %
(the effect of 1.3 times the size), and with the sign flipped. The test of the study must fail each
time. A rule wrong by 30 % gives a size that is wrong by 23 %, which a study can know only where it
tells the size better than that: its standard deviation is printed beside. Some minutes on one core.
"""

import argparse
import json

from bayesdeg.analysis.judge import Judgement
from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause
from bayesdeg.data.study import read_study
from tests.hidden_effects.judging import idle, judged, scaled, verdict_with
from tests.hidden_effects.test_planted_studies import (
    SINGLE,
    STUDIES,
    TWO,
    assert_found,
    assert_named,
    hidden_in,
)

MUTATIONS = {"idle": idle, "wrong by 30 %": scaled(1.3), "flipped": scaled(-1.0)}


def fails(judgement: Judgement, number: str, name: str, mutation: str) -> bool:
    """Return whether the test of a study fails with a cause made wrong."""
    mutated = verdict_with(judgement, name, MUTATIONS[mutation])
    check = assert_named if number == TWO else assert_found
    try:
        check(mutated, hidden_in(number))
    except AssertionError:
        return True
    return False


def relative_sd(judgement: Judgement, cause: Cause) -> float:
    """Return the standard deviation of a cause's size over its mean."""
    [found] = (one for one in judgement.candidates if one.cause == cause.name)
    size = found.effect[cause.parameters[0].name]
    return abs(size.sd / size.mean)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--studies", nargs="+", default=[*SINGLE, TWO], metavar="NUMBER")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found = []
    for number in asked.studies:
        judgement = judged(assemble(read_study(STUDIES / number)))
        for name in hidden_in(number):
            row: dict[str, object] = {"study": number, "cause": name}
            row["size_sd"] = round(relative_sd(judgement, CATALOGUE[name]), 3)
            row |= {one: fails(judgement, number, name, one) for one in MUTATIONS}
            found.append(row)
            if not asked.json:
                print(*row.values(), sep="\t", flush=True)
    if asked.json:
        shares = {one: sum(bool(row[one]) for row in found) / len(found) for one in MUTATIONS}
        print(json.dumps({"failed": shares, "studies": found}, indent=1))


if __name__ == "__main__":
    main()
