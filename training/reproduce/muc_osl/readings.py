"""What all experiments of the paper have in common: its policies, its headline claims, and what it does not state."""

from __future__ import annotations

from training.reproduce.claims import Beats, Claim

PAPER_POLICIES = ("muc-osl", "col-pf", "adap-pp", "col-inf")
REMARKS = (
    "The paper gives curves and claims, not tables, and leaves open the sensor's radius, the sampling time and the "
    "rule by which a run counts as successful: its minutes cannot be compared with ours. Here A = a Q dt = 2.5 m, a "
    "source is found only if it is declared within 5 m, and a wrong declaration is a failure."
)


def headline() -> tuple[Claim, ...]:
    """MUC-OSL has the best SR and the shortest MST throughout; the Col-PF half of it is not expected to hold always."""
    rivals = (("col-inf", "Col-Inf"), ("adap-pp", "Adap-PP"), ("col-pf", "Col-PF"))
    measures = (("success_rate", "a higher SR"), ("capped_search_time", "a shorter MST"))
    return tuple(
        Beats(f"MUC-OSL has {advantage} than {name}", "muc-osl", rival, measure)
        for rival, name in rivals
        for measure, advantage in measures
    )
