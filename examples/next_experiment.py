"""Which experiment next.

The run of the gelatin study has named an offset of the pressure. What would confirm or refute it,
with how much evidence on average, and at what price in specimens? Here it is read from the
published report; ``bayesdeg next REPORT`` prints the same.
"""

import json
from pathlib import Path

verdict = json.loads(Path("reports/gelatin_actuator/verdict.json").read_text())
print(verdict["outcome"], *verdict["causes"], end="\n\n")
for experiment in verdict["next_experiments"][:4]:
    gain, price = experiment["expected_log_bayes_factor"], experiment["specimens"]
    print(f"{gain:7.1f} log Bayes factor, {price} specimens: {experiment['design']}")
