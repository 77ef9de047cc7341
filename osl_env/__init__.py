"""osl_env: a batched simulator of teams of UAVs that search gas sources in 3D, behind the standard RL interfaces.

    import osl_env
    env = osl_env.parallel_env("rate-100x60x30")      # PettingZoo
    worlds = osl_env.make_vec("rate-100x60x30", 1024)  # Gymnasium VectorEnv

Importing it registers `osl_env/Solo-v0` and `osl_env/Team-v0` with Gymnasium and `osl_env/Team-v0` with PettingZoo.
"""

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as _version

from osl_env.envs.parallel import env, parallel_env
from osl_env.envs.registration import register_envs
from osl_env.envs.vector import make_vec
from osl_env.errors import InputError
from osl_env.kernel_cache import drop_stale_kernels
from osl_env.observation import Observation
from osl_env.record import EpisodeRecord
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario, scenario_names
from osl_env.world import World

try:
    __version__ = _version("osl-env")
except PackageNotFoundError:  # a source tree that has not been installed
    __version__ = "0+unknown"

drop_stale_kernels()  # before the first kernel is called, which is when numba looks for it
register_envs()

__all__ = [
    "EpisodeRecord",
    "InputError",
    "Observation",
    "Scenario",
    "World",
    "__version__",
    "env",
    "load_scenario",
    "make_vec",
    "parallel_env",
    "scenario_names",
]
