"""The ids under which Gymnasium and PettingZoo know the environments."""

from __future__ import annotations

import gymnasium as gym
import pettingzoo


def register_envs() -> None:
    """Register `osl_env/Solo-v0` and `osl_env/Team-v0` with Gymnasium, and `osl_env/Team-v0` with PettingZoo, once."""
    entries = {
        "osl_env/Solo-v0": ("osl_env.envs.single:SoloEnv", "osl_env.envs.vector:solo_vector_env"),
        "osl_env/Team-v0": ("osl_env.envs.single:TeamEnv", "osl_env.envs.vector:TeamVectorEnv"),
    }
    for name, (entry_point, vector_entry_point) in entries.items():
        if name not in gym.registry:
            gym.register(name, entry_point=entry_point, vector_entry_point=vector_entry_point)
    register = getattr(pettingzoo, "register", None)
    if register is None:  # the registry came with PettingZoo 1.26
        return
    from pettingzoo.env_registry.registration import parallel_registry

    if "osl_env/Team-v0" not in parallel_registry:
        register("parallel", "osl_env/Team-v0", "osl_env.envs.parallel:parallel_env")
