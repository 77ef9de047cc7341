"""Scripted policies: the literature's algorithms and our reference, behind one interface (see `baselines.policy`)."""

from baselines.policy import Belief, Briefing, GasMap, Policy, make_policy, policy_class, policy_names, register_policy

__all__ = ["Belief", "Briefing", "GasMap", "Policy", "make_policy", "policy_class", "policy_names", "register_policy"]
